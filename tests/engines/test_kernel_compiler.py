"""Kernels' own compiler against Python, which runs the same text slowly."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bwbn_bayes import BoucWen, FolientePinching, PerStorey, ShearBuilding, SlipLock, SuddenDamage, Uniform, el_centro
from bwbn_bayes.engines import lane_laws, scalar
from bwbn_bayes.engines.kernel import Kernel, heads_of
from bwbn_bayes.engines.kernel_compiler import KINDS, object_code, signatures
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.structures.structure import Structure


def in_python(source: str) -> dict[str, Any]:
    """The functions of a kernel's text as Python understands them."""
    names: dict[str, Any] = {
        **dict.fromkeys(KINDS, None),
        "int": int,
        "float": float,
        "double": float,
        "bool": bool,
        "np": np,
        "_bits": lambda x: np.float64(x).view(np.int64),
        "_from_bits": lambda b: np.int64(b).view(np.float64),
    }
    exec(compile(source, "kernel", "exec"), names)
    return names


WORDS = """
LANES = 16
ROW = 2 * LANES
IS_ROUND = False


def _inverse(x):
    \"\"\"One over a number, or nothing.\"\"\"
    x = 1.0 if x == 0.0 else x
    return 1.0 / x


def before(i, table):
    return i > 0 and table[i - 1, 1] < 3


def largest(n, x):
    found = -np.inf
    for i in range(n):
        found = x[i] if x[i] > found else found
    return found


def scale(x, factor, room):
    for l in range(LANES):
        kept = abs(x[l]) * factor
        is_large = kept > 1.0 and kept < 9.0 or kept == 0.0
        room[l] = _inverse(kept) if is_large else np.ceil(kept)
        room[LANES + l] += room[l] - np.rint(kept)


def rows(table, first, out):
    later = table[first:]
    flat = np.ravel(later)
    for i in range(flat.shape[0]):
        out[0] += flat[i] * later.shape[1]
    out[1] = np.exp2(table[0, 1]) + np.log2(abs(table[1, 0]))
    out[2] = max(min(int(10.0 * table[0, 0]), 2), -3) + int(-2.7)
    out[3] = min(np.inf - np.inf, 1.0)
    out[4] = max(1.0, np.inf - np.inf)
    if IS_ROUND:
        out[5] = nothing_that_there_is
    else:
        out[5] = 1.5 if IS_ROUND else 2.5


def run(n: int, dt: float, twice: bool, x: floats, table: integers_2d, picked: integers, measured: floats_2d,
        out: floats) -> float:
    room = out[ROW:]
    later = out[0:]
    for i in range(table.shape[0]):
        out[0] += float(table[i, 0]) if before(i, table) else -1.0
    out[1] = largest(n, x)
    for j in range(measured.shape[0]):
        now = measured[j]
        ahead = min(j + 1, measured.shape[0] - 1)
        out[2] += now[1] - measured[ahead, 0] / dt
        if j == 2:
            break
    scale(x, 2.5, room)
    if twice:
        scale(x, 1, room)
    else:
        later = out[3:]
    left = 5
    while not left < 3:
        later[0] += left
        left -= 1
    total = 0.0
    for l in range(LANES):
        total += room[picked[l]]
    out[4] = total
    for k in range(1, 3):
        out[5] += (k * (k + 3) // 2) << 2
    rows(measured, 2, out[70:])
    return total
"""


@pytest.mark.parametrize("twice", [False, True])
def test_a_text_means_what_it_means_in_python(twice: bool) -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([[0.0, -0.4], rng.normal(size=30)])
    table, picked = np.array([[2, 1], [3, 5], [7, 1]]), rng.integers(0, 32, 16)
    measured = rng.normal(size=(5, 2))
    found, expected = np.zeros(100), np.zeros(100)
    total = Kernel("probe", WORDS).run(20, 0.1, twice, x, table, picked, measured, found)
    result = in_python(WORDS)["run"](20, 0.1, twice, x, table, picked, measured, expected)
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    assert total == pytest.approx(result, rel=1e-14)
    assert np.isnan(found[73])  # a comparison with what is no number chose the other


OF_A_LIBRARY = """
def qsort(numbers: doubles, count: int, size: int, order: int): ...
def ilogb(x: double) -> int32: ...
def ldexp(x: double, power: int32) -> double: ...


def backwards(left: int, right: int) -> int32:
    one = _doubles_at(left, 1)
    other = _doubles_at(right, 1)
    return -1 if one[0] > other[0] else (1 if one[0] < other[0] else 0)


def taken(base: double, powers: int, count: int32) -> double:
    power = _integers_at(powers, count)
    total = 0.0
    for i in range(count):
        total += ldexp(base, power[i])
    return total


def run(x: floats) -> int:
    qsort(x, x.shape[0], 8, backwards)
    return ilogb(x[x.shape[0] - 1]) - 1
"""


def test_a_library_is_called_and_calls_back() -> None:
    """C's own: numbers of 32 bits keep their sign, arrays are addresses, a function is where it begins."""
    x = np.random.default_rng(1).uniform(0.26, 9.0, 50)
    x[7], expected = 0.26, np.sort(np.append(np.delete(x, 7), 0.26))[::-1]
    kernel = Kernel("probe", OF_A_LIBRARY).functions("run", "taken")
    assert kernel.run(x) == -3
    np.testing.assert_array_equal(x, expected)
    powers = np.array([-1, 3, 0])
    assert kernel.taken(1.5, powers.ctypes.data, 3) == 0.75 + 12.0 + 1.5


def test_a_function_of_its_last_argument() -> None:
    """What was given is read anew at every call, and lives as long as the function."""
    text = "def run(x: floats, n: int, t: float) -> float:\n    x[1] += 1.0\n    return x[0] * t + n\n"
    text += "def first(x: floats) -> float:\n    return x[0]\n"
    kernel = Kernel("probe", text).functions("run", "first")
    x = np.array([2.0, 0.0])
    run, first = kernel.run.given(x, 3), kernel.first.given(x)
    assert (run(0.5), first()) == (4.0, 2.0)
    x[0] = 5.0
    assert (run(2.0), first()) == (13.0, 5.0)
    assert x[1] == 2.0
    with pytest.raises(AttributeError, match="second is not among the functions that were asked for"):
        _ = kernel.second
    with pytest.raises(struct.error, match="expected 4 items"):
        kernel.run(x, 3)


STOREY = BoucWen(k=PerStorey(Uniform(20, 60)), c=0.3, alpha=0.05, beta=Uniform(1, 80), gamma=15.0, n=1.2)
PINCHED = FolientePinching(zeta_s=0.6, p=0.8, q=0.2, psi_0=0.1, delta_psi=0.02, lambda_=0.3)
MODELS = {
    "building": ShearBuilding(masses=[1.0, 2.0], storey=STOREY)
    .with_effect(SlipLock(delta_s=Uniform(0.0, 0.1), sigma=0.05))
    .with_effect(SuddenDamage(parameter="k", jump=-5.0, time=Uniform(0.01, 0.05)), storeys=[2]),
    "pinched": ShearBuilding(masses=[1.0, 2.0], storey=STOREY).with_effect(PINCHED),
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_a_kernel_comes_to_what_python_makes_of_its_text(model: Structure, monkeypatch: pytest.MonkeyPatch) -> None:
    """Values, sums and derivatives of a few samples, with an event and refined steps."""
    ground = el_centro("chopra", duration=0.16)
    record = ground.with_channels({name: np.array(ground.excitation) for name in ("acceleration_1", "acceleration_2")})
    engine = Lanes(substeps=1, resolution=0.5, n_threads=1)
    draws = model.space.from_unit(model.space.sample_unit(np.random.default_rng(1), 2))

    def solved() -> list[np.ndarray]:
        response, slopes = engine.sensitivities(model, draws, record)
        sums = engine.normal_equations(model, draws, record)
        return [response.values, slopes, engine.misfit(model, draws, record), sums.gradient, sums.information]

    compiled = solved()
    run_in_python(monkeypatch)
    with np.errstate(all="ignore"):
        expected = solved()
    forget_kernels()
    agree(compiled, expected)


@pytest.mark.parametrize(
    ("source", "entries"),
    [(WORDS, ("run",)), (OF_A_LIBRARY, ("qsort", "ldexp", "backwards", "taken", "run"))],
    ids=["words", "of a library"],
)
def test_the_heads_of_a_text_say_what_its_functions_take(source: str, entries: tuple[str, ...]) -> None:
    assert signatures(heads_of(source), entries) == signatures(source, entries)


@pytest.mark.parametrize("single", [False, True])
def test_the_heads_of_a_law_are_a_small_part_of_it(single: bool) -> None:
    """The whole was read in every process, for what two of its lines say."""
    kernel, _ = lane_laws.kernel_of(MODELS["building"].law, False, single)
    heads, entries = heads_of(kernel.source), ("run", "run_with_tangents")
    assert signatures(heads, entries) == signatures(kernel.source, entries)
    assert len(heads) < 0.2 * len(kernel.source)


def run_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on kernels are Python's."""
    forget_kernels()

    def functions(self: Kernel, *entries: str) -> SimpleNamespace:
        names = in_python(self.source)
        return SimpleNamespace(**{entry: names[entry] for entry in entries})

    monkeypatch.setattr(Kernel, "functions", functions)


def forget_kernels() -> None:
    for made in (lane_laws._made, lane_laws.summarise, scalar.scalar_kernel):
        made.cache_clear()


def agree(compiled: list[np.ndarray], expected: list[np.ndarray]) -> None:
    for one, other in zip(compiled, expected, strict=True):
        scale = np.max(np.abs(other))
        assert scale > 0.0
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11 * scale)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_a_scalar_kernel_comes_to_what_python_makes_of_its_text(
    model: Structure, monkeypatch: pytest.MonkeyPatch
) -> None:
    ground = el_centro("chopra", duration=0.16)
    names = ("acceleration_1", "drift_2", "restoring_force_1")
    draws = model.space.from_unit(model.space.sample_unit(np.random.default_rng(1), 1))
    engine = ScalarRk4(substeps=1, resolution=0.5)

    def solved() -> list[np.ndarray]:
        response, slopes = engine.sensitivities(model, draws, ground, names)
        return [response.values, slopes, engine.simulate(model, draws, ground, names).values]

    compiled = solved()
    run_in_python(monkeypatch)
    with np.errstate(all="ignore"):
        expected = solved()
    forget_kernels()
    agree(compiled, expected)


@pytest.mark.parametrize(
    "line",
    [
        *("import os", "x[0] = len(x)", "x[0] = [1.0][0]", "del x", "x[0] = x", "return", "with x: pass"),
        *("for a in x: pass", "assert x", "x[0] = 'a'", "x[0] = 1 % 2", "x[0]: float = 1.0", "y = 1; y = 0.5"),
        *("return 1.0", "y = int(x)", "y = other(x)", "y = np.ravel(1.0)"),
    ],
)
def test_other_words_are_refused(line: str) -> None:
    """A generator that writes what the compiler does not know must hear of it, not solve something else."""
    with pytest.raises((NotImplementedError, TypeError, KeyError, AssertionError)):
        object_code(f"LANES = 16\ndef run(x: floats):\n    {line}\n", "run")


@pytest.mark.parametrize("x", [np.zeros(4, dtype=np.float32), np.zeros((4, 2))[:, 0], np.zeros(4, dtype=np.int64)])
def test_arrays_of_another_kind_are_refused(x: np.ndarray) -> None:
    """Machine code would read them as what they are not."""
    kernel = Kernel("probe", "LANES = 16\ndef run(x: floats):\n    x[0] = 1.0\n")
    with pytest.raises(TypeError, match="a kernel takes floats that lie row after row"):
        kernel.run(x)

"""Kernels' own compiler against Python, which runs the same text slowly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bwbn_bayes import BoucWen, FolientePinching, PerStorey, ShearBuilding, SlipLock, SuddenDamage, Uniform, el_centro
from bwbn_bayes.engines import lane_laws
from bwbn_bayes.engines.lane_compiler import KINDS, object_code
from bwbn_bayes.engines.lane_kernel import LaneKernel
from bwbn_bayes.engines.lanes import Lanes
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


def run(n: int, dt: float, twice: bool, x: floats, table: integers_2d, picked: integers, measured: floats_2d,
        out: floats):
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
"""


@pytest.mark.parametrize("twice", [False, True])
def test_a_text_means_what_it_means_in_python(twice: bool) -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([[0.0, -0.4], rng.normal(size=30)])
    table, picked = np.array([[2, 1], [3, 5], [7, 1]]), rng.integers(0, 32, 16)
    measured = rng.normal(size=(5, 2))
    found, expected = np.zeros(100), np.zeros(100)
    LaneKernel("probe", WORDS).run(20, 0.1, twice, x, table, picked, measured, found)
    in_python(WORDS)["run"](20, 0.1, twice, x, table, picked, measured, expected)
    np.testing.assert_allclose(found, expected, rtol=1e-14)


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
    monkeypatch.setattr(LaneKernel, "function", lambda self, entry: in_python(self.source)[entry])
    for made in (lane_laws._made, lane_laws.summarise):
        made.cache_clear()
    with np.errstate(all="ignore"):
        expected = solved()
    for made in (lane_laws._made, lane_laws.summarise):
        made.cache_clear()
    for one, other in zip(compiled, expected, strict=True):
        scale = np.max(np.abs(other))
        assert scale > 0.0
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11 * scale)


@pytest.mark.parametrize(
    "line",
    [
        *("import os", "x[0] = len(x)", "x[0] = [1.0][0]", "del x", "x[0] = x", "return", "with x: pass"),
        *("for a in x: pass", "assert x", "x[0] = 'a'", "x[0] = 1 % 2", "x[0]: float = 1.0", "y = 1; y = 0.5"),
    ],
)
def test_other_words_are_refused(line: str) -> None:
    """A generator that writes what the compiler does not know must hear of it, not solve something else."""
    with pytest.raises((NotImplementedError, TypeError, KeyError, AssertionError)):
        object_code(f"LANES = 16\ndef run(x: floats):\n    {line}\n", "run")


@pytest.mark.parametrize("x", [np.zeros(4, dtype=np.float32), np.zeros((4, 2))[:, 0], np.zeros(4, dtype=np.int64)])
def test_arrays_of_another_kind_are_refused(x: np.ndarray) -> None:
    """Machine code would read them as what they are not."""
    kernel = LaneKernel("probe", "LANES = 16\ndef run(x: floats):\n    x[0] = 1.0\n")
    with pytest.raises(TypeError, match="a kernel takes floats that lie row after row"):
        kernel.run(x)

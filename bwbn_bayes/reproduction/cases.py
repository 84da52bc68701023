"""The paper's cases as models and records.

References
----------
.. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, tables 1 and 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock, StiffnessDegradation, StrengthDegradation, SuddenDamage
from bwbn_bayes.parameters import PerStorey, Uniform, Value
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.reproduction.printed import Row, one_row, printed
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

MethodName = Literal["IPV", "GA", "TMCMC"]
Excitation = Literal["Sin", "ElCentro"]

METHODS: tuple[MethodName, ...] = get_args(MethodName)
STOREYS = (1, 2, 3)
DAMAGE_TIMES: Mapping[Excitation, tuple[float, float, float]] = {
    "Sin": (30.0, 60.0, 100.0),
    "ElCentro": (10.0, 20.0, 40.0),
}
"""When the paper damages a storey. [s]"""

_PER_STOREY = ("k", "c")
_SHARED = ("alpha", "beta", "gamma", "n", "delta_nu", "delta_eta", "delta_s", "sigma")
_JUMPS = {"delta_nu_jump": "delta_nu_1", "delta_eta_jump": "delta_eta_1"}
_IPV_N = 1.0


@dataclass(frozen=True, kw_only=True, order=True)
class Case:
    """One printed line: a method under an excitation at a noise level, with a group of degradation parameters."""

    method: MethodName
    group: int
    snr: Literal["inf", "30", "10"]
    excitation: Excitation

    @property
    def snr_db(self) -> float | None:
        """Signal-to-noise ratio [dB]; None without noise."""
        return None if self.snr == "inf" else float(self.snr)

    @property
    def key(self) -> str:
        """Name of the case's files."""
        return f"{self.method}_group{self.group}_snr{self.snr}_{self.excitation}"


def cases_of(table: int) -> tuple[Case, ...]:
    """The cases a table prints, in its order; none for the tables of assignments (1 and 4).

    Parameters
    ----------
    table : int
        From 1 to 7.
    """
    if table in (1, 4):
        return ()
    rows = [(row, int(row.get("group", "1"))) for row in printed(table)]
    return tuple(
        Case(method=row["method"], group=group, snr=row["snr_db"], excitation=row["excitation"])  # type: ignore[arg-type]
        for row, group in rows
    )


def excitation_of(excitation: Excitation, options: Options) -> Record:
    """The ground motion of a case."""
    if excitation == "ElCentro":
        return el_centro(options.el_centro_version, scale=options.el_centro_scale)
    return options.sine


def truth_of(case: Case) -> dict[str, float]:
    """True value of every parameter of the paper's building, by label, A included."""
    first = one_row(1, excitation=case.excitation, quantity="true")
    group = _group(case, "true")
    shared = {name: float(first[name]) for name in ("A", *_SHARED)}
    return {
        **{f"{name}[{i}]": float(first[f"{name}{i}"]) for name in _PER_STOREY for i in STOREYS},
        **shared,
        **({"n": _IPV_N} if case.method == "IPV" else {}),
        **{label: float(group[column]) - float(group[label.removesuffix("_jump")]) for label, column in _JUMPS.items()},
    }


def building(case: Case, options: Options, *, identified: bool) -> Structure:
    """The three-storey building: with the printed bounds as uniform priors, or at its true values.

    Parameters
    ----------
    case : Case
        Gives bounds (tables 1 and 4) and damage times.
    options : Options
        Order of the damages, and whether A is identified.
    identified : bool
        Priors, or the truth.
    """
    truth = truth_of(case)

    def value(label: str) -> float | Uniform:
        if not identified or case.method == "IPV" or (label == "A" and not options.free_a):
            return truth[label]
        return Uniform(*_bounds(case, label))

    def per_storey(name: str) -> Value:
        return PerStorey([value(f"{name}[{i}]") for i in STOREYS])

    times = DAMAGE_TIMES[case.excitation]
    damaged = PerStorey(times if options.damage_order == "123" else times[::-1])
    row = one_row(1, excitation=case.excitation, quantity="true")
    storey = BoucWen(
        k=per_storey("k"),
        c=per_storey("c"),
        alpha=value("alpha"),
        A=value("A"),
        beta=value("beta"),
        gamma=value("gamma"),
        n=value("n"),
    )
    return (
        ShearBuilding(masses=[float(row[f"m{i}"]) for i in STOREYS], storey=storey)
        .with_effect(StrengthDegradation(delta_nu=value("delta_nu")))
        .with_effect(StiffnessDegradation(delta_eta=value("delta_eta")))
        .with_effect(SlipLock(delta_s=value("delta_s"), sigma=value("sigma")))
        .with_effect(SuddenDamage(parameter="delta_nu", jump=value("delta_nu_jump"), time=damaged))
        .with_effect(SuddenDamage(parameter="delta_eta", jump=value("delta_eta_jump"), time=damaged))
    )


def printed_column(label: str) -> str:
    """Column of the printed tables that holds a parameter: ``k[1]`` stands under k1."""
    return _JUMPS.get(label, label.replace("[", "").replace("]", ""))


def _group(case: Case, quantity: str) -> Row:
    return one_row(4, method=case.method, excitation=case.excitation, group=str(case.group), quantity=quantity)


def _bounds(case: Case, label: str) -> tuple[float, float]:
    column = printed_column(label)
    if column.startswith(("delta_nu", "delta_eta")):
        low, high = (_group(case, side)[column] for side in ("lower", "upper"))
    else:
        low, high = (one_row(1, excitation=case.excitation, quantity=side)[column] for side in ("lower", "upper"))
    return float(low), float(high)

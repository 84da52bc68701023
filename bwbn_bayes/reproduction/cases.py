"""The paper's cases as models and records, and everything it leaves open as an option.

References
----------
.. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, tables 1 and 4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from bwbn_bayes.baselines.genetic import GeneticSettings
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock, StiffnessDegradation, StrengthDegradation, SuddenDamage
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import PerStorey, Uniform, Value
from bwbn_bayes.records.excitation import ElCentroVersion, el_centro, sine
from bwbn_bayes.records.record import Record
from bwbn_bayes.reproduction.printed import Row, one_row, printed
from bwbn_bayes.structures.shear_building import ShearBuilding

MethodName = Literal["IPV", "GA", "TMCMC"]
Excitation = Literal["Sin", "ElCentro"]
DamageOrder = Literal["123", "321"]

METHODS: tuple[MethodName, ...] = get_args(MethodName)
EXCITATIONS: tuple[Excitation, ...] = get_args(Excitation)
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
_GROWING = (0.1, 0.2, 0.4, 0.7, 1.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the paper leaves open, and how much to compute.

    Parameters
    ----------
    damage_order : {"123", "321"}
        Which storey is damaged first, second, third.
    sine_amplitude, sine_frequency_hz, sine_duration, sine_time_step : float
        The sine. [m/s^2], [Hz], [s], [s]
    el_centro_version : {"rsn6_180", "chopra"}
        Component and source of El Centro.
    el_centro_scale : float
        Factor on it.
    error_floor : float
        Error of noise-free records in Bayesian cases, as a share of each channel's rms.
    free_a : bool
        Whether A is identified, as in the paper; it shares one scale with k, alpha, beta, gamma and sigma.
    particles : int
        TMCMC particles; the paper's 5,000.
    generations : int
        Generations of the genetic algorithm; the paper's 30 leave it short.
    growing : bool
        Whether its generations are judged by growing parts of the record.
    seed : int
        First seed of noise and method.
    seeds : int
        Number of seeds of TMCMC's noisy cases in group 1; those after the first use a fifth of the particles.
    quick : bool
        Whether this is a small run, for a first look.

    Raises
    ------
    UserError
        If a number is out of range.
    """

    damage_order: DamageOrder = "123"
    sine_amplitude: float = 0.5
    sine_frequency_hz: float = 0.2
    sine_duration: float = 150.0
    sine_time_step: float = 0.02
    el_centro_version: ElCentroVersion = "rsn6_180"
    el_centro_scale: float = 1.0
    error_floor: float = 1e-2
    free_a: bool = False
    particles: int = 5000
    generations: int = 175
    growing: bool = True
    seed: int = 1
    seeds: int = 1
    quick: bool = False

    def __post_init__(self) -> None:
        if self.damage_order not in get_args(DamageOrder):
            raise UserError(f"damage order is {self.damage_order!r}: it must be 123 or 321")
        if self.seeds < 1 or self.seed < 0 or self.particles < 100:
            raise UserError("seeds must be at least 1, seed at least 0 and particles at least 100")
        if not self.error_floor > 0.0:
            raise UserError(f"error floor is {self.error_floor:g}: a noise-free posterior needs a positive one")
        _ = self.genetic
        if not (math.isfinite(self.el_centro_scale) and self.el_centro_scale != 0.0):
            raise UserError(f"El Centro scale is {self.el_centro_scale}: it must be a finite number other than zero")
        excitation_of("Sin", self)

    @property
    def further_particles(self) -> int:
        """Particles for seeds after the first, whose posterior means alone are of interest."""
        return max(100, self.particles // 5)

    @property
    def genetic(self) -> GeneticSettings:
        """Settings of the genetic algorithm."""
        return GeneticSettings(generations=self.generations, windows=_GROWING if self.growing else (1.0,))

    def sentences(self) -> tuple[tuple[str, str], ...]:
        """Every option with its present value, and what it settles, for the page."""
        windows = "growing parts of the record in turn" if self.growing else "the whole record"
        a_words = (
            "A is identified, as in the paper" if self.free_a else "A is fixed at 1, because no record can tell it"
        )
        return (
            (f"--damage-order {self.damage_order}", "The paper does not say which storey is damaged first."),
            (
                f"--sine-amplitude {self.sine_amplitude:g} --sine-frequency {self.sine_frequency_hz:g}",
                f"m/s^2 and Hz; not printed. {self.sine_duration:g} s at {self.sine_time_step:g} s are ours too.",
            ),
            (
                f"--el-centro {self.el_centro_version} --el-centro-scale {self.el_centro_scale:g}",
                "The paper names neither component nor scale.",
            ),
            (
                "SNR in dB of mean square, white noise on each floor's total acceleration",
                "The paper gives numbers only.",
            ),
            (
                f"--error-floor {self.error_floor:g}",
                "Share of each channel's rms taken as error where TMCMC has no noise; the residual is then not white.",
            ),
            ("--free-a" if self.free_a else "(no --free-a)", f"{a_words}."),
            (
                f"--particles {self.particles}",
                "The paper used 5,000 and does not say how many Metropolis steps; moves here go on until decorrelated.",
            ),
            (
                f"--generations {self.generations}" + ("" if self.growing else " --whole-record"),
                f"Judged by {windows}; the paper: 30 generations. Population 100, elite 10, crossover 0.6 as printed.",
            ),
            (
                f"--seed {self.seed} --seeds {self.seeds}",
                f"Noise and methods; further seeds (TMCMC with noise, group 1): {self.further_particles} particles.",
            ),
            (
                "jumps of delta_nu and delta_eta keep the past work",
                "nu = 1 + delta_nu(t) epsilon; the paper is silent.",
            ),
            ("IPV with n = 1, GA and TMCMC with n = 1.5", "As printed; IPV trains on the record alone."),
        )


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
    return sine(options.sine_amplitude, options.sine_frequency_hz, options.sine_duration, options.sine_time_step)


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


def building(case: Case, options: Options, *, identified: bool) -> ShearBuilding:
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
        k=per_storey("k"), c=per_storey("c"), **{name: value(name) for name in ("alpha", "A", "beta", "gamma", "n")}
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

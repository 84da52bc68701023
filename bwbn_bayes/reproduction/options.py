"""Everything that the paper leaves open, as an option.

References
----------
.. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, tables 1 and 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from bwbn_bayes.errors import UserError

if TYPE_CHECKING:
    from bwbn_bayes.baselines.genetic import GeneticSettings
    from bwbn_bayes.records.excitation import ElCentroVersion
    from bwbn_bayes.records.record import Record

DamageOrder = Literal["123", "321"]

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
        _ = self.sine

    @property
    def sine(self) -> Record:
        """The sine."""
        from bwbn_bayes.records.excitation import sine

        return sine(self.sine_amplitude, self.sine_frequency_hz, self.sine_duration, self.sine_time_step)

    @property
    def further_particles(self) -> int:
        """Particles for seeds after the first, whose posterior means alone are of interest."""
        return max(100, self.particles // 5)

    @property
    def genetic(self) -> GeneticSettings:
        """Settings of the genetic algorithm."""
        from bwbn_bayes.baselines.genetic import GeneticSettings

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

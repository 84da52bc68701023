"""Options of one identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal

from bwbn_bayes.engines.names import NAMES
from bwbn_bayes.errors import UserError, require_kind, whole_number
from bwbn_bayes.inference.registry import METHODS

_CHOICES = {
    "method": tuple(METHODS),
    "engine": NAMES,
    "variant": ("default", "plain"),
    "sampler": ("pymc", "nutpie"),
}
_OF_METHODS = {"variant": ("tmcmc", "smc", "importance"), "sampler": ("nuts",)}
"""Methods that an option has a meaning for; where importance sampling fails its check, TMCMC takes over."""
_LEAST = {"seed": 0, "particles": 1, "workers": 1}
MOST_PARTICLES = 10_000_000
"""Beyond that memory ends before patience does."""


def require_whole(options: Any, least: Mapping[str, int]) -> None:
    """Raise :class:`UserError` unless each of these is a whole number from so many on; NumPy's become Python's own."""
    for name, fewest in least.items():
        given = whole_number(f"{type(options).__name__}: {name}", getattr(options, name), fewest)
        object.__setattr__(options, name, given)


def require_checkpoint(options: Any) -> None:
    """Raise :class:`UserError` unless the checkpoint is a path or none."""
    told = f"{type(options).__name__}: checkpoint"
    require_kind(told, options.checkpoint, (Path, NoneType), 'give the path of a file without suffix, as Path("run")')


def require_few_particles(particles: int) -> None:
    """Raise :class:`UserError` where no memory would hold them."""
    if particles > MOST_PARTICLES:
        raise UserError(f"particles is {particles}, it must be {MOST_PARTICLES} at most: give fewer")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Options of one run.

    Parameters
    ----------
    method : {"importance", "tmcmc", "smc", "nuts", "ga", "ipv"}
        The road to the posterior, of which smc and nuts are PyMC's; the last two are baselines without a posterior.
    engine : str
        Name of the engine.
    seed : int
        The run is a function of it.
    particles : int
        Effective draws wanted (importance, which weighs at least 2,000) or particles (TMCMC).
    variant : {"default", "plain"}
        TMCMC as calibrated, or as published; SMC with the batched kernel, or with PyMC's own.
    fallback : bool
        Whether TMCMC takes over where importance sampling fails its check; if not, its draws stand with the check
        failed; where hardly one has any weight, draws of the normal approximation at the optima do.
    sampler : {"pymc", "nutpie"}
        Whose NUTS.
    alternatives : bool
        Whether the catalogue is asked what else would explain the record: a second once its law is compiled, which
        takes up to half a minute the first time.
    checkpoint : Path, optional
        Name (without suffix) under which is kept what was solved, and from which a run that was cut off goes on to the
        same result, bit for bit but for its times.
    workers : int
        Processes that solve; with one, the threads of this process do.
    scheduler : str, optional
        Address of a Dask scheduler whose workers solve instead.
    """

    method: str = "importance"
    engine: str = "lanes"
    seed: int = 1
    particles: int = 5000
    variant: Literal["default", "plain"] = "default"
    fallback: bool = True
    sampler: Literal["pymc", "nutpie"] = "pymc"
    alternatives: bool = True
    checkpoint: Path | None = None
    workers: int = 1
    scheduler: str | None = None

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            given = getattr(self, name)
            if given not in choices:
                raise UserError(f"Settings: {name} {given!r} is not known: choose one of {', '.join(choices)}")
        for name, methods in _OF_METHODS.items():
            given = getattr(self, name)
            if given != _CHOICES[name][0] and self.method not in methods:
                raise UserError(
                    f"{name} {given} says nothing to method {self.method}: leave it out, or choose method "
                    f"{' or '.join(methods)}"
                )
        require_whole(self, _LEAST)
        require_few_particles(self.particles)
        require_checkpoint(self)

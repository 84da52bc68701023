"""Every method by its name. To add one, write its class and a line here: options, refusals and reports follow."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, cast

from bwbn_bayes.errors import UserError, require_installed

if TYPE_CHECKING:
    from pathlib import Path

    from bwbn_bayes.inference.method import Method


class Entry(NamedTuple):
    """What is known of a method without loading it."""

    title: str
    """In sentences and reports."""
    home: str
    """``module:class``, loaded on first use: libraries of one method are no concern of the others."""
    extra: str = ""
    """The extra that brings its library, if any."""
    has_posterior: bool = True
    """Whether it samples one."""
    keeps: bool = True
    """Whether it has anything to keep in a checkpoint."""


METHODS: Mapping[str, Entry] = {
    "importance": Entry("importance sampling", "bwbn_bayes.inference.by_importance:ByImportance"),
    "tmcmc": Entry("transitional MCMC", "bwbn_bayes.inference.by_tmcmc:ByTmcmc"),
    "smc": Entry("PyMC's sequential Monte Carlo", "bwbn_bayes.inference.by_pymc:BySmc", "pymc"),
    "nuts": Entry("the No-U-Turn sampler", "bwbn_bayes.inference.by_pymc:ByNuts", "pymc"),
    "ga": Entry(
        "a genetic algorithm (one point, no posterior)",
        "bwbn_bayes.baselines.by_search:BySearch",
        "ga",
        has_posterior=False,
    ),
    "ipv": Entry(
        "intelligent parameter varying (radial basis networks, forces only)",
        "bwbn_bayes.baselines.by_networks:ByNetworks",
        has_posterior=False,
        keeps=False,
    ),
}


def title_of(name: str) -> str:
    """What a method is called in sentences."""
    return METHODS[name].title if name in METHODS else name


def require_library(name: str, sampler: str = "pymc") -> None:
    """Refuse a method, and a sampler of NUTS, whose library is not installed; nothing is loaded.

    Raises
    ------
    UserError
        Naming the library and the extra.
    """
    if name == "nuts" and sampler == "nutpie":
        require_installed("nuts", "sampler nutpie")
    elif METHODS[name].extra:
        require_installed(METHODS[name].extra, f"method {name}")


def require_possible(name: str, *, unnamed_force: bool, checkpoint: Path | None) -> None:
    """Refuse what a method cannot do, whatever model and record are; nothing is loaded.

    Raises
    ------
    UserError
        If a force beside the model is asked of a method without a posterior, or a checkpoint of one that keeps none.
    """
    if unnamed_force and not METHODS[name].has_posterior:
        raise UserError(f"method {name} samples no posterior that an unnamed force could widen: leave it out")
    if checkpoint is not None and not METHODS[name].keeps:
        raise UserError(f"method {name} is done in seconds and keeps no checkpoint: leave it out")


def method(name: str) -> Method:
    """The method of a name in :data:`METHODS`."""
    module, _, kind = METHODS[name].home.partition(":")
    return cast("Method", getattr(import_module(module), kind)())

"""Every method by its name. To add one, write its class and a line here: options, refusals and reports follow."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, cast

from bwbn_bayes.errors import require_installed

if TYPE_CHECKING:
    from bwbn_bayes.inference.method import Method


class Entry(NamedTuple):
    """What is known of a method without loading it."""

    title: str
    """In sentences and reports."""
    home: str
    """``module:class``, loaded on first use: libraries of one method are no concern of the others."""
    extra: str = ""
    """The extra that brings its library, if any."""


METHODS: Mapping[str, Entry] = {
    "importance": Entry("importance sampling", "bwbn_bayes.inference.by_importance:ByImportance"),
    "tmcmc": Entry("transitional MCMC", "bwbn_bayes.inference.by_tmcmc:ByTmcmc"),
    "smc": Entry("PyMC's sequential Monte Carlo", "bwbn_bayes.inference.by_pymc:BySmc", "pymc"),
    "nuts": Entry("the No-U-Turn sampler", "bwbn_bayes.inference.by_pymc:ByNuts", "pymc"),
    "ga": Entry("a genetic algorithm (one point, no posterior)", "bwbn_bayes.baselines.by_search:BySearch", "ga"),
    "ipv": Entry(
        "intelligent parameter varying (radial basis networks, forces only)",
        "bwbn_bayes.baselines.by_networks:ByNetworks",
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


def method(name: str) -> Method:
    """The method of a name in :data:`METHODS`."""
    module, _, kind = METHODS[name].home.partition(":")
    return cast("Method", getattr(import_module(module), kind)())

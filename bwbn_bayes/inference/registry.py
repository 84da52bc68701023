"""Every method by its name. To add one, write its class and a line here: options, refusals and reports follow."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, cast

if TYPE_CHECKING:
    from bwbn_bayes.inference.method import Method


class Entry(NamedTuple):
    """What is known of a method without loading it."""

    title: str
    """In sentences and reports."""
    home: str
    """``module:class``, loaded on first use: libraries of one method are no concern of the others."""


METHODS: Mapping[str, Entry] = {
    "importance": Entry("importance sampling", "bwbn_bayes.inference.by_importance:ByImportance"),
    "tmcmc": Entry("transitional MCMC", "bwbn_bayes.inference.by_tmcmc:ByTmcmc"),
    "smc": Entry("PyMC's sequential Monte Carlo", "bwbn_bayes.inference.by_pymc:BySmc"),
    "nuts": Entry("the No-U-Turn sampler", "bwbn_bayes.inference.by_pymc:ByNuts"),
    "ga": Entry("a genetic algorithm (one point, no posterior)", "bwbn_bayes.baselines.by_search:BySearch"),
    "ipv": Entry(
        "intelligent parameter varying (radial basis networks, forces only)",
        "bwbn_bayes.baselines.by_networks:ByNetworks",
    ),
}


def title_of(name: str) -> str:
    """What a method is called in sentences."""
    return METHODS[name].title if name in METHODS else name


def method(name: str) -> Method:
    """The method of a name in :data:`METHODS`."""
    module, _, kind = METHODS[name].home.partition(":")
    return cast("Method", getattr(import_module(module), kind)())

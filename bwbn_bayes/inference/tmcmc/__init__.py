"""Transitional Markov chain Monte Carlo: a posterior and its evidence by tempering from the prior or a reference."""

from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult, sample
from bwbn_bayes.inference.tmcmc.target import (
    DefensiveMixture,
    PriorReference,
    Reference,
    Target,
)

__all__ = ["DefensiveMixture", "PriorReference", "Reference", "Target", "TmcmcResult", "sample"]

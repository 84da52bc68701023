"""PyMC's samplers as methods; PyMC takes seconds to load, which the others need not pay."""

from __future__ import annotations

from typing import Literal, override

from bwbn_bayes.inference.identify import Sampling
from bwbn_bayes.inference.method import Task
from bwbn_bayes.inference.registry import require_library
from bwbn_bayes.inference.sampled import Given, Sampled


class BySmc(Sampling):
    """Sequential Monte Carlo, with the batched kernel or PyMC's own."""

    @override
    def refuse(self, task: Task) -> None:
        super().refuse(task)
        require_library("smc")

    @override
    def sample(self, given: Given) -> Sampled:
        return _sampled(given, "smc")


class ByNuts(Sampling):
    """The No-U-Turn sampler, PyMC's or nutpie's."""

    @override
    def refuse(self, task: Task) -> None:
        super().refuse(task)
        require_library("nuts", task.settings.sampler)

    @override
    def sample(self, given: Given) -> Sampled:
        return _sampled(given, "nuts")


def _sampled(given: Given, method: Literal["smc", "nuts"]) -> Sampled:
    from bwbn_bayes.inference.pymc.roads import sample_road

    settings = given.settings
    road = sample_road(
        given.target,
        given.modes,
        method=method,
        plain=settings.variant == "plain",
        sampler=settings.sampler,
        particles=settings.particles,
        seed=settings.seed,
        say=given.history.say,
    )
    return Sampled(method, *road)

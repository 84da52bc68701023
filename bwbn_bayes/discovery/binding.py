"""Priors of the model as given that bind: they are widened before an effect is named to stand in for one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from bwbn_bayes.inference.doubts import LARGEST_GAIN
from bwbn_bayes.inference.identifiability import open_combinations
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode, held_back
from bwbn_bayes.parameters import Constraint, Floats, FreeParameter, Prior, Truncated, Uniform
from bwbn_bayes.structures.hardening import free_of
from bwbn_bayes.structures.structure import Structure

_AT_A_BOUND = 1e-3
"""Prior probability beyond a best fit that lies at the end of its prior."""


@dataclass(frozen=True, kw_only=True)
class Binding:
    """Which priors of the model as given bind at its best fit, and what is done about it.

    Attributes
    ----------
    given : Posterior
        Of the model as given.
    best : Mode
        Its best fit.
    """

    given: Posterior
    best: Mode

    def sentences(self, *, hardens: bool = False) -> tuple[str, ...]:
        """Which parameters fit best at an end of their prior, and what was done about it, one sentence or two each.

        The record need not want them there: of one that it says little about any value fits about as well.

        Parameters
        ----------
        hardens : bool
            Whether its loops were let harden.
        """
        open_to = open_combinations(self.best.information, self.given.space.names)
        unseen, wider = {names[0] for names in open_to if len(names) == 1}, self._wider
        told = []
        for parameter, above in _binding(self.given, self.best.point):
            name, prior, end = parameter.name, parameter.prior, "upper" if above else "lower"
            if name in unseen:
                text = (
                    f"The best fit of the model as given lies at the {end} end of the prior of {name}, {prior}, though "
                    "the record says little about it."
                )
            else:
                text = f"The prior of {name}, {prior}, binds: the best fit of the model as given lies at its {end} end."
            told.append(f"{text} The prior was widened to {wider[name]}." if name in wider else text)
        if self._condition is not None:
            cut = self._condition.text
            text = f"The priors bind where {cut} cuts them: the best fit of the model as given lies there."
            told.append(f"{text} They were widened to loops that harden (hardens=True)." if hardens else text)
        return tuple(told)

    @property
    def widened(self) -> Structure | None:
        """The model with each uniform prior that binds widened by its own width at that end; None where none is.

        No further than the law admits.
        """
        return self.given.model.with_values(self._wider) if self._wider else None

    @property
    def hardening(self) -> Structure | None:
        """The model with loops that may harden, its priors widened too, where the condition binds that they must not.

        None where it does not, and where an effect of the model needs the bound of a loop that does not.
        """
        freed = None if self._condition is None else free_of(self.given.model, self._condition)
        return None if freed is None else freed.with_values(self._wider)

    @cached_property
    def _condition(self) -> Constraint | None:
        """The joint condition beyond which lies a fit that chance alone would not make so much better."""
        held = held_back(self.given, self.best)
        return held[0] if held is not None and held[1] > LARGEST_GAIN else None

    @cached_property
    def _wider(self) -> dict[str, Prior]:
        return _wider(self.given, self.best.point)


def _wider(given: Posterior, best: Floats) -> dict[str, Prior]:
    """The wider prior of each parameter that has one."""
    admissible = {p.symbol: (p.lower, p.upper) for p in given.model.parameters}
    wider: dict[str, Prior] = {}
    for parameter, above in _binding(given, best):
        prior = parameter.prior
        if isinstance(prior, Uniform):
            low, high = admissible[parameter.symbol]
            width = prior.upper - prior.lower
            ends = (
                (prior.lower, min(prior.upper + width, high)) if above else (max(prior.lower - width, low), prior.upper)
            )
            wider[parameter.name] = Uniform(*ends)
    return wider


def _binding(given: Posterior, best: Floats) -> list[tuple[FreeParameter, bool]]:
    """Parameters whose best fit lies at an end of a bounded prior, which is not the law's own; whether at the upper."""
    admissible = {p.symbol: (p.lower, p.upper) for p in given.model.parameters}
    found = []
    for parameter, u in zip(given.space.parameters, best.tolist(), strict=True):
        if not isinstance(parameter.prior, (Uniform, Truncated)) or parameter.symbol not in admissible:
            continue
        above = u > 0.5
        end = parameter.prior.support[1 if above else 0]
        if not _AT_A_BOUND < u < 1.0 - _AT_A_BOUND and end != admissible[parameter.symbol][1 if above else 0]:
            found.append((parameter, above))
    return found

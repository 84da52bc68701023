"""What a search needs to look for an effect: sizes to expect, where fits start, freer forms, kin.

An effect is physics alone; this stands beside it, in an object of its own. Without one the effect can be placed in a
model, and no search looks for it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.errors import UserError


class SearchGuide[EffectClass: Effect](Protocol):
    """How a search looks for one class of effects."""

    family: ClassVar[str] = ""
    """What the effect and its kin are, in words, such as "a loss of strength or stiffness": that one of them is there
    may be certain where which one is not."""

    @abstractmethod
    def priors(self, scales: Scales) -> tuple[EffectClass, ...]:
        """The effect with the priors that a search gives it, once for each form worth trying.

        An amplitude has a prior of one sign or both (half-normal, normal) that is centred on its neutral value and as
        wide as the sizes to expect, so that it can be made wider and narrower; what vanishes at neutral (a width, a
        time, a gap) has a bounded prior.

        Parameters
        ----------
        scales : Scales
            Of the training record under the model that lacks the effect, at the place where it is looked for.
        """
        ...

    @abstractmethod
    def starts(self, effect: EffectClass, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        """Values of each identified parameter, by symbol, from which fits start; every combination is tried.

        Parameters
        ----------
        effect : Effect
            One of the forms that :meth:`priors` or :meth:`free_shapes` gave.
        scales : Scales
            As they were there.
        """
        ...

    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        """Forms with a free shape that contain one of :meth:`priors`, or come close to it, with priors.

        They are tried where one of these leads and leaves more than noise. They have its mechanism, and symbols of
        their own; sizes that their parameters are measured by, such as the largest drift, are known parameters. Those
        of another class have a guide of their own.
        """
        return ()


_GUIDES: dict[type[Effect], SearchGuide[Any]] = {}


def guides[GuideClass: type[SearchGuide[Any]]](effect_class: type[Effect]) -> Callable[[GuideClass], GuideClass]:
    """Let searches look for a class of effects by a guide; use it as a decorator of the guide's class.

    Raises
    ------
    UserError
        If the guide lacks the priors or the starts.
    """

    def kept(guide_class: GuideClass) -> GuideClass:
        missing = sorted(getattr(guide_class, "__abstractmethods__", ()))
        if missing:
            raise UserError(f"guide {guide_class.__qualname__}: its method {missing[0]} is missing: add it")
        _GUIDES[effect_class] = guide_class()
        return guide_class

    return kept


def is_sought(effect_class: type[Effect]) -> bool:
    """Whether searches look for a class of effects: it has a guide."""
    return effect_class in _GUIDES


def guide_of(effect_class: type[Effect]) -> SearchGuide[Any]:
    """The guide of a class of effects.

    Raises
    ------
    UserError
        If it has none.
    """
    try:
        return _GUIDES[effect_class]
    except KeyError:
        name = effect_class.__qualname__
        raise UserError(f"effect {name}: no search looks for it: write @guides({name}) over a guide") from None

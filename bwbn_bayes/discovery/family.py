"""One form of an effect at all its places at once.

A solve costs the same for one start as for sixteen, so that the places of an effect share a block: the family's model
has the effect at every place, and each candidate holds it neutral at all places but its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.parameters import Booleans, Floats, PerStorey, Prior
from bwbn_bayes.structures.parts import PlacedEffect
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class Family:
    """Hypotheses of one form of one effect that differ in their place alone."""

    members: tuple[Hypothesis, ...]

    @cached_property
    def model(self) -> Structure:
        """The present model with the effect at every member's place."""
        first = self.members[0]
        if len(self.members) == 1:
            return first.model
        storeys = tuple(s for member in self.members for s in member.storeys)
        placed = PlacedEffect(effect=_everywhere([member.effect for member in self.members]), storeys=storeys)
        return replace(first.base, carried=first.carried, effects=(*first.base.effects, placed))

    def columns(self, member: Hypothesis) -> list[int]:
        """Where a member's coordinates stand among the family's."""
        names = self.model.space.names
        return [names.index(name) for name in member.model.space.names]

    @cached_property
    def known(self) -> NDArray[np.int64]:
        """Where the present model's coordinates stand among the family's."""
        names = self.model.space.names
        return np.array([names.index(name) for name in self.members[0].base.space.names])

    def embed(self, member: Hypothesis, points: Floats) -> tuple[Floats, Booleans]:
        """A member's points ``(n, n_dim)`` among the family's coordinates, and which of those are held."""
        space, columns = self.model.space, self.columns(member)
        neutral = np.array([self._neutral.get(name, 0.0) for name in space.names])
        result = np.tile(space.to_unit(neutral[None]), (len(points), 1))
        result[:, columns] = points
        held = np.ones(result.shape, dtype=np.bool_)
        held[:, columns] = False
        return result, held

    def extract(self, member: Hypothesis, local: Linearisation) -> Linearisation:
        """The expansion in the member's own coordinates."""
        columns = self.columns(member)
        return Linearisation(
            log_likelihood=local.log_likelihood,
            gradient=local.gradient[:, columns],
            information=local.information[:, columns][:, :, columns],
        )

    def embed_expansion(self, member: Hypothesis, local: Linearisation) -> Linearisation:
        """The expansion at a member's points among the family's coordinates, of which those that are held are zero."""
        columns, n = self.columns(member), self.model.space.n_dim
        gradient, information = (np.zeros((len(local.gradient), *(n,) * times)) for times in (1, 2))
        gradient[:, columns] = local.gradient
        information[:, np.array(columns)[:, None], columns] = local.information
        return Linearisation(log_likelihood=local.log_likelihood, gradient=gradient, information=information)

    def posterior(self, present: Posterior) -> Posterior:
        """The posterior of the family's model."""
        return present.with_model(self.model)

    @cached_property
    def _neutral(self) -> dict[str, float]:
        return {name: member.neutral(name) for member in self.members for name in member.brought}


def families(hypotheses: Sequence[Hypothesis]) -> tuple[Family, ...]:
    """Group hypotheses by effect and form; one that acts on every storey alike is a family of its own."""
    groups: dict[tuple[tuple[str, ...], bool], list[Hypothesis]] = {}
    for hypothesis in hypotheses:
        groups.setdefault((hypothesis.symbols, len(hypothesis.storeys) > 1), []).append(hypothesis)
    return tuple(Family(members=tuple(sorted(members, key=lambda m: m.storeys))) for members in groups.values())


def _everywhere(effects: Sequence[Effect]) -> Effect:
    """One effect whose identified parameters have each place's own prior, and whose known ones its own value."""
    first = effects[0]
    symbols = set(first.values.values())
    changed = {}
    for one in fields(first):  # type: ignore[arg-type]
        own = [getattr(effect, one.name) for effect in effects]
        if isinstance(own[0], Prior) or (own[0] in symbols and not isinstance(own[0], str)):
            changed[one.name] = PerStorey(own)
    return replace(first, **changed)  # type: ignore[type-var]

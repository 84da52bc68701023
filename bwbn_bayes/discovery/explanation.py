"""A model that could be the answer: the given one with effects added, and perhaps a force of no known law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.cross_validation import CrossValidation, cross_validated
from bwbn_bayes.discovery.evidence import Evidence, laplace
from bwbn_bayes.discovery.where import Disagreement, disagreement
from bwbn_bayes.inference.least_squares import squares
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.residuals import leaves_noise, leaves_quiet, residual_of
from bwbn_bayes.inference.unnamed.further_link import FurtherLink, Span
from bwbn_bayes.inference.unnamed.reading import ReadingError
from bwbn_bayes.inference.unnamed.state_function import StateForce
from bwbn_bayes.inference.unnamed.storey import Estimate
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

Key = frozenset[tuple[tuple[str, ...], tuple[int, ...]]]
"""Symbols and places of effects: each form of each effect has symbols of its own."""

Place = tuple[int, ...] | Span | str
"""Where something is that has no name: storeys in which a force acts, nodes that a link joins, or a channel whose
reading has an error."""


def forced_storeys(place: Place | None) -> tuple[int, ...]:
    """Storeys in which a force acts that has no name; none where it is something else, or nothing."""
    return place if isinstance(place, tuple) and not isinstance(place, Span) else ()


_N_STARTS = 3


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A model that could be the answer.

    Attributes
    ----------
    added : tuple of Hypothesis
        Effects that the model as given lacks, in the order in which they were added.
    posterior : Posterior
        Of its parameters, for white noise and without an unnamed force: what it predicts by.
    modes : tuple of Mode
        Optima of that, best first.
    evidence : Evidence
        Under its own account of the errors.
    unnamed : tuple of int, Span, str or None
        Storeys in which it has a force of no known law, the nodes of a further link, or the channel whose sensor has an
        error of no known kind; None where it has none of these, as no explanation of a specimen has.
    estimate : Estimate, StateForce, FurtherLink or ReadingError, optional
        What is expected of it in a building; a link and a force of one state are part of the model in ``posterior``.
    n_places : int
        Places at which it could be: one storey, all, two nodes, or a channel.
    starts : (n, n_dim) array, optional
        Further points from which fits start.
    """

    added: tuple[Hypothesis, ...]
    posterior: Posterior
    modes: tuple[Mode, ...]
    evidence: Evidence
    unnamed: Place | None = None
    estimate: Estimate | StateForce | FurtherLink | ReadingError | None = None
    n_places: int = 1
    starts: Floats | None = None

    @property
    def has_unnamed(self) -> bool:
        """Whether something without a name is part of it."""
        return self.unnamed is not None

    @property
    def is_specimen(self) -> bool:
        """Whether a displacement is imposed on it."""
        return self.posterior.record.excitation_kind == "displacement"

    @cached_property
    def effects_key(self) -> Key:
        """Which effects it adds, and where."""
        return key_of(self.added)

    @cached_property
    def placed(self) -> frozenset[tuple[str, tuple[int, ...]]]:
        """Names and places of its effects."""
        return frozenset((hypothesis.name, hypothesis.storeys) for hypothesis in self.added)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of its effects."""
        return frozenset(hypothesis.name for hypothesis in self.added)

    def loop_shows(self, name: str) -> bool:
        """Whether the record itself measures what one of its effects does: a specimen's loop, of some signatures."""
        signatures = (own.effect.signature for own in self.added if own.name == name)
        return self.is_specimen and any(one.of_loop is not None for one in signatures)

    @property
    def n_parameters(self) -> int:
        """Identified parameters that its effects bring."""
        return sum(hypothesis.n_brought for hypothesis in self.added)

    @property
    def label(self) -> str:
        """Its effects in words."""
        parts = [hypothesis.label for hypothesis in self.added]
        if isinstance(self.unnamed, str):
            parts.append(f"an error of no known kind in {self.unnamed}")
        elif isinstance(self.unnamed, Span):
            parts.append(f"a further link between {self.unnamed.in_words}")
        elif self.unnamed is not None:
            place = " in every storey" if len(self.unnamed) > 1 else f" in storey {self.unnamed[0]}"
            parts.append(f"a force of no known law{place if self.n_places > 1 else ''}")
        return " + ".join(parts) or "the model as given"

    @property
    def model(self) -> Structure:
        """The model itself."""
        return self.posterior.model

    @property
    def best(self) -> Floats:
        """Its best fit ``(n_dim,)``, in the unit cube."""
        return self.modes[0].point

    def is_fitted_as(self, other: Explanation) -> bool:
        """Whether it is the same model, solved in the same way, at the same fit, in whatever process it was made."""
        same = self.model == other.model and self.posterior.engine == other.posterior.engine
        return same and np.array_equal(self.best, other.best)

    def with_modes(self, modes: tuple[Mode, ...]) -> Explanation:
        """The same with other optima of its posterior, and Laplace's evidence of these."""
        return replace(self, modes=modes, evidence=laplace(self.posterior, modes))

    @property
    def points(self) -> Floats:
        """Points ``(n, n_dim)`` of its unit cube from which fits with a further effect start."""
        own = np.array([mode.point for mode in self.modes[:_N_STARTS]])
        return own if self.starts is None else np.concatenate([own, self.starts])

    @property
    def fits(self) -> Floats:
        """Its best fit, and that to the record's beginning where it is known, ``(n, n_dim)``."""
        return self.best[None] if self.starts is None else np.stack([self.best, self.starts[0]])

    @cached_property
    def disagreement(self) -> Disagreement:
        """Where it disagrees with the record."""
        return disagreement(self.posterior, self.best)

    @cached_property
    def cross_validation(self) -> CrossValidation:
        """How well it predicts blocks of the training record under its own account of the errors.

        A building's unnamed force takes no part.
        """
        return cross_validated(self.evidence.posterior, self.evidence.modes[0].point)

    @cached_property
    def whole(self) -> tuple[Posterior, Floats]:
        """Its posterior with what has no name acting, or taken off the record, and the fit that goes with it.

        Without a force to first order where it leaves more, once it is solved for, than the laws do by themselves: with
        little damping a response is linear in forces far smaller than its own.
        """
        if isinstance(self.estimate, Estimate | ReadingError):
            posterior, point = self.estimate.beside(self.posterior)
            if isinstance(self.estimate, ReadingError) or self._explains_more(posterior, point):
                return posterior, point
        return self.posterior, self.best

    def _explains_more(self, posterior: Posterior, point: Floats) -> bool:
        """Whether a fit is better than that of the laws by themselves, under the account of errors of the evidence."""
        own = self.evidence
        beside = posterior.with_noise(own.posterior.noise).log_likelihood(point[None])[0]
        return bool(beside > own.modes[0].log_likelihood)

    @cached_property
    def residual(self) -> Floats:
        """What its laws by themselves leave of the record at their best fit, ``(n_channels, n_times)``."""
        return residual_of(self.posterior, self.best)

    def over_noise(self, rows: Floats) -> float:
        """What rows ``(n_channels, n_times)`` cost beside what it leaves, in nat: half their squares over its noise."""
        noise = self.evidence.posterior.noise
        return 0.5 * float(np.sum(self._precision * squares(self.posterior.record, rows[None], noise.correlation)))

    @cached_property
    def _precision(self) -> Floats:
        """Of its noise ``(1, n_blocks)``, by its own account of the errors."""
        posterior, point = self.whole
        return posterior.with_noise(self.evidence.posterior.noise).precision(point[None])

    @cached_property
    def is_noise(self) -> bool:
        """Whether what it leaves could be noise."""
        return leaves_noise(*self.whole)

    @cached_property
    def is_quiet(self) -> bool:
        """Whether nothing of note is left, so that a score tells what a further effect could gain."""
        return leaves_quiet(self.posterior, self.best)


def key_of(added: Sequence[Hypothesis]) -> Key:
    """Which effects are added, and where."""
    return frozenset((hypothesis.symbols, hypothesis.storeys) for hypothesis in added)

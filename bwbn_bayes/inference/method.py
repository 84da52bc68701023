"""The one interface of every method, sampler or baseline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from bwbn_bayes.inference.history import Listener
from bwbn_bayes.inference.likelihood import Noise, Posterior
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Check, Result
from bwbn_bayes.structures.structure import Structure

Beside = Callable[[Posterior, Floats], tuple[Check, ...]]
"""Checks of a posterior at its optimum ``(n_dim,)``."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a method is given; the attributes are the arguments of :func:`bwbn_bayes.identify`.

    ``beside`` asks, at the optimum of a posterior, what else would explain the record.
    """

    model: Structure
    record: Record
    settings: Settings
    noise: Noise | None = None
    options: object = None
    name: str = "model"
    assumptions: Sequence[str] = ()
    listener: Listener | None = None
    beside: Beside | None = None
    unnamed_force: bool = False


class Method(Protocol):
    """A way from a model and a record to a result; listed in :mod:`bwbn_bayes.inference.registry`."""

    def identify(self, task: Task) -> Result:
        """Carry out a task.

        Raises
        ------
        UserError
            Before any work: if nothing is to be identified, the record measures nothing, record and model do not belong
            together, the options are those of another method, or its library is not installed.
        """
        ...

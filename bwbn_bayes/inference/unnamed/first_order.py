"""A response to first order in the parameters, as an engine that every sampler can ask."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.engines.base import Response, Status
from bwbn_bayes.engines.reduction import Reduction
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstOrder(Reduction):
    """The measured channels of one model under one record, linear about a point.

    Parameters
    ----------
    values : (n_parameters,) array
        The point, in the parameters' own units.
    response : (n_channels, n_times) array
        There. [units of the channels]
    slopes : (n_parameters, n_channels, n_times) array
        Its derivatives there.
    scheme : str
        What solved them.
    """

    values: Floats
    response: Floats
    slopes: Floats
    scheme: str

    name = "first order"

    def __repr__(self) -> str:
        """With all its numbers in a hash: what is kept of its answers is kept under this name."""
        digest = hashlib.sha256(b"".join(array.tobytes() for array in (self.values, self.response, self.slopes)))
        return f"FirstOrder({digest.hexdigest()}, {self.scheme!r})"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """The measured channels; it knows of no others."""
        names = tuple(record.channels)
        if channels is not None and tuple(channels) != names:
            raise ValueError("a response to first order is known of the measured channels alone")
        values = self.response + np.tensordot(draws - self.values, self.slopes, axes=1)
        return Response(channels=names, values=values, status=np.full(len(draws), Status.OK))

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """The response, and derivatives that are everywhere the same."""
        response = self.simulate(model, draws, record, channels)
        return response, np.repeat(self.slopes[None], len(draws), axis=0)

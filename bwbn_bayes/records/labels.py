"""What is known of a record beside its numbers, as text that travels with them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import Record


@dataclass(frozen=True, kw_only=True)
class Labels:
    """What a file says about its record beside the numbers.

    ``time_step`` is in s, None where it is not stated; ``has_time`` is false where a time column counts points alone.
    """

    name: str
    time_step: float | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    truth: Mapping[str, float] = field(default_factory=dict)
    noise_sd: Mapping[str, float] = field(default_factory=dict)
    has_time: bool = True


def labels_as_json(record: Record) -> str:
    """Everything but the numbers, for the attribute ``record`` of a dataset or a data frame."""
    return json.dumps(
        {
            "name": record.name,
            "time_step": record.time_step,
            "channels": list(record.channels),
            "provenance": dict(record.provenance),
            "truth": dict(record.truth),
            "noise_sd": dict(record.noise_sd),
            "has_time": record.has_time,
        }
    )


def labels_of_json(text: object, name: str, place: str) -> tuple[Labels, list[str]]:
    """Labels and the order of the channels from the attribute ``record``, None where there is none.

    Raises
    ------
    UserError
        If the attribute is not what :func:`labels_as_json` writes; ``place`` says where it is.
    """
    try:
        facts = json.loads("{}" if text is None else text)  # type: ignore[arg-type]  # what is no text raises TypeError
        stated = facts.get("time_step")
        labels = Labels(
            name=str(facts.get("name", name)),
            time_step=None if stated is None else float(stated),
            provenance={str(key): str(value) for key, value in facts.get("provenance", {}).items()},
            truth={str(key): float(value) for key, value in facts.get("truth", {}).items()},
            noise_sd={str(key): float(value) for key, value in facts.get("noise_sd", {}).items()},
            has_time=bool(facts.get("has_time", True)),
        )
        return labels, [str(channel) for channel in facts.get("channels", [])]
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        raise UserError(f"{place}: the attribute 'record' is damaged, remove it or write it anew") from None

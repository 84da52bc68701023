"""One page of many records: a line for each, with a link to its own report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from bwbn_bayes.report.html import template
from bwbn_bayes.report.numbers import NOTHING, html_symbol, percent, significant, with_uncertainty


@dataclass(frozen=True, kw_only=True)
class BatchRow:
    """What came of one record.

    Attributes
    ----------
    record : str
        Its name.
    status : str
        ``done``, ``done, with care`` (a check failed), ``refused`` or ``waiting``.
    sentence : str
        Which check failed, what was found, or why it was refused.
    report : str
        Address of its own report, beside the page; empty where there is none.
    nrmse : float or None
        Largest misfit of its channels.
    log_evidence : float or None
    elapsed_s : float or None
        [s]
    parameters : mapping of str to (float, float)
        Mean and sd, SI.
    """

    record: str
    status: str
    sentence: str
    report: str = ""
    nrmse: float | None = None
    log_evidence: float | None = None
    elapsed_s: float | None = None
    parameters: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """One entry of ``batch.json``."""
        return asdict(self)


def batch_page(rows: Sequence[BatchRow]) -> str:
    """The page as text; every text is escaped.

    Parameters
    ----------
    rows : sequence of BatchRow
        In the order in which they are shown.
    """
    names = list(dict.fromkeys(name for row in rows for name in row.parameters))
    counts = {status: sum(row.status == status for row in rows) for status in dict.fromkeys(row.status for row in rows)}
    return template("batch.html.j2").render(
        counts=[f"{count} {status}" for status, count in counts.items()],
        n_records=len(rows),
        symbols=[html_symbol(name) for name in names],
        rows=[(row, _share(row.nrmse), [_moments(row.parameters.get(name)) for name in names]) for row in rows],
    )


def _share(nrmse: float | None) -> str:
    return NOTHING if nrmse is None else percent(nrmse)


def _moments(pair: tuple[float | None, float | None] | None) -> str:
    mean, sd = pair or (None, None)
    if mean is None:
        return NOTHING
    return significant(mean) if sd is None else " ± ".join(with_uncertainty((mean, sd), sd))

"""Reports: content gathers, figures draw, html renders. No statistics beyond percentiles of draws."""

from typing import TYPE_CHECKING

from bwbn_bayes.lazily import importer

if TYPE_CHECKING:
    from bwbn_bayes.report.discovery_html import write_discovery
    from bwbn_bayes.report.html import ReportFiles, write_report

__all__ = ["ReportFiles", "write_discovery", "write_report"]

__getattr__ = importer(
    {
        "bwbn_bayes.report.discovery_html": ("write_discovery",),
        "bwbn_bayes.report.html": ("ReportFiles", "write_report"),
    }
)

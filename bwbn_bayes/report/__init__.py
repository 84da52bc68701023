"""Reports: content gathers, figures draw, html renders. No statistics beyond percentiles of draws."""

from bwbn_bayes.report.discovery_html import write_discovery
from bwbn_bayes.report.html import ReportFiles, write_report

__all__ = ["ReportFiles", "write_discovery", "write_report"]

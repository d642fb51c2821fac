"""Pages: a report in one file, and the explorer. Drawn in the browser by Plotly, which only here is needed."""

from hbgear.web.reporting import Report, report

__all__ = ["Report", "report"]

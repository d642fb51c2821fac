"""Web pages: a report in one file, and the explorer; Plotly, which only this package needs, draws the figures."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _late

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.web.reporting import Report, report

__all__ = ["Report", "report"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _late.attached(__name__)

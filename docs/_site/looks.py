"""Settings of the figures of the scripts, reset before each script."""

from typing import Any


def reset(gallery: Any, name: str) -> None:
    """Restore the defaults of matplotlib, with a resolution for high-density screens."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcdefaults()
    matplotlib.rcParams.update({"savefig.dpi": 144, "figure.dpi": 144})

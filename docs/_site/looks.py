"""How figures of the scripts look: set anew before each of them."""

from typing import Any


def reset(gallery: Any, name: str) -> None:
    """Matplotlib's own settings, at a resolution for screens of any density."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcdefaults()
    matplotlib.rcParams.update({"savefig.dpi": 144, "figure.dpi": 144})

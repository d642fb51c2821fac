"""Files of curves, and bridges to other programs."""

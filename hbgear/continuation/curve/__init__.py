"""Points and segments of a curve, and the branch built from them."""

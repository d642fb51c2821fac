"""Special points of curves of exact motions: test functions, grazing points, and their curves in two parameters."""

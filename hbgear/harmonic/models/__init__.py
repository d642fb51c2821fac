"""Models of curves: the registry that rebuilds them from files, and their frequencies in physical units."""

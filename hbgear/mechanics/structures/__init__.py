"""Linear structures: matrices, speed-dependent terms, receptances, reduction."""

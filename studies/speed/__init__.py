"""Measured times, and comparison with other packages."""

"""Models of gear pairs."""

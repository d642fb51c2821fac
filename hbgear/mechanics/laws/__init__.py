"""Force laws of elements."""

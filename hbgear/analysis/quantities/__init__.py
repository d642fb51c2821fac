"""Engineering quantities along a branch, and their units on axes and in tables."""

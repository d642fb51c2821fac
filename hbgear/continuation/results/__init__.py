"""Results of a continuation: branches, points, status."""

"""Detection and location of special points, and their errors."""

"""Linear algebra and scalar root finding."""

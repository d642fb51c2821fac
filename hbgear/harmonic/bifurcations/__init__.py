"""Events of periodic motions and their augmented equations."""

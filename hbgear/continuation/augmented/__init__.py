"""Minimally augmented equations of special points."""

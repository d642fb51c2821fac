"""Comparison of traced curves with time integration."""

"""Gear trains."""

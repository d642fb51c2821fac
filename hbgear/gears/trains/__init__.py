"""Gear trains and planetary sets."""

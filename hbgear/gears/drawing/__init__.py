"""Gears and pairs as they are drawn: geometry, tooth compliance, backlash."""

"""Foundations of all packages: checks of arguments, ranges, units, messages, atomic writes, signals."""

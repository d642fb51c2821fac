"""Integration of motions with events of laws that have memory or dampers."""

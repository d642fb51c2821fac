"""The continuation loop."""

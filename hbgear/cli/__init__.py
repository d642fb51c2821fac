"""The command ``hbgear``."""

"""Verified stability: errors, parity checks, exact motions."""

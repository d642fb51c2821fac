"""Figures of many designs: studies, sensitivities, fits, bands."""

"""Figures of studies, sensitivities, fits and uncertainty bands."""

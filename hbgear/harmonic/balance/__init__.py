"""Parts of the class HarmonicBalance: equations, quantities of motions, resolution, additions to branches."""

"""Parts of the class HarmonicBalance: equations, quantities of motions, additions to branches."""

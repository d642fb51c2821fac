"""The linear structure, condensed to the element displacements."""

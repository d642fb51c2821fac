"""Readers of matrix files: Matrix Market and MATLAB."""

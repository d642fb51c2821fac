"""Files of matrices: Matrix Market and MATLAB."""

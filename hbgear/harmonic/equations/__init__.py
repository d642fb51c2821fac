"""The balance equations: discretisation, residual and Jacobian, compiled loops."""

"""Newton's method: fixed parameters, on the arclength plane, homotopy, deflation."""

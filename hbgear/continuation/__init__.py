"""Follows the solutions of any equations R(X, p) = 0 around folds, finds what happens on the way and branches off."""

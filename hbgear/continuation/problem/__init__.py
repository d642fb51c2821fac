"""Problems R(X, p) = 0: abilities, the base class with defaults, finite differences."""

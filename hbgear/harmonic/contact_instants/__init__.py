"""Problem of periodic motions in contact instants, its special points and branches, and hard stops."""

"""The mesh: stiffness and transmission error over a cycle, ISO 6336 values."""

"""Tables of numbers with units: receptances, mesh cycles, measurements."""

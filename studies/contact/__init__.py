"""Contact: what the exact projection of backlash gains over samples of it."""

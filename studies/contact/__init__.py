"""Contact: accuracy of the exact projection of backlash and of AFT."""

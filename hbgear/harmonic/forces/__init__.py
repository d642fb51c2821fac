"""Forces of the elements in the frequency domain: exact projection and AFT."""

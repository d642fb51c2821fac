"""Text: messages, numbers in words, symbols, decoding of files."""

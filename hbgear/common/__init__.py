"""What every room stands on: checks of arguments, ranges, words of errors, files written whole, signals."""

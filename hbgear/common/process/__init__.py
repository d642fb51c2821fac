"""The process: signals, threads, compiled code, progress."""

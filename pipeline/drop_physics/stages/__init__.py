"""The verbs of `drop`: functions that take paths and return a typed result."""

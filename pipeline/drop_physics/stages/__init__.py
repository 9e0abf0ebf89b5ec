"""The verbs: each takes paths, does one thing, and returns a typed result."""

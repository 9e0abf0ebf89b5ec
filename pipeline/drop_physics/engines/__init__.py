"""A room for each engine: build its world, step it, read it, photograph it."""

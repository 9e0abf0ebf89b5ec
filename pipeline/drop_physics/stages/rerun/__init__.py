"""Runs of a script with changes: the possible changes, and the ways of running."""

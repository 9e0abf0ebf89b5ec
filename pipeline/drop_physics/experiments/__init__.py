"""Runs of a script with something changed, compared with its own run."""

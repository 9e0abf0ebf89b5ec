"""Runs of a script with changes, compared with its own run."""

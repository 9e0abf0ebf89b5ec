"""Runs a script again with changes: lists the possible changes, and makes the runs."""

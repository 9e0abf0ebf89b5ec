"""Runs a script again with changes: which are possible, and how the runs are made."""

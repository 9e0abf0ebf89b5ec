"""Repeat a script's run with changes: which changes are possible, and how runs are made."""

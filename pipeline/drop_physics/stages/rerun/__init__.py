"""Run a script again with something changed: what may be changed, and how the runs are made."""

"""Run a script with changes, and compare these runs with its own run."""

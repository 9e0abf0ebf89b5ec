"""Sweeps over many scenarios: plan the runs, execute them, and store a table of their results."""

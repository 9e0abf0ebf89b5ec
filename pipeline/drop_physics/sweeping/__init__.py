"""Sweeps over many scenarios: plans the runs, makes them, and stores their results."""

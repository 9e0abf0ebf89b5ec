"""Sweeps over many scenarios: plans the runs, executes them, and stores their results."""

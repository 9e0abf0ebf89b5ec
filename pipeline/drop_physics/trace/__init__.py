"""Observations of a simulation run by another program, whatever its engine."""

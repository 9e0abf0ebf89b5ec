"""Compares two recordings: inputs, calls, samples."""

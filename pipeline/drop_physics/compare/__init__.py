"""Differences between two recordings: inputs, calls, samples."""

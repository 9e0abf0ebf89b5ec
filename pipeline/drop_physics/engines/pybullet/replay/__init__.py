"""Repeats a script's recorded calls in the script's own interpreter."""

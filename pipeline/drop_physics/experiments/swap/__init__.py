"""Finds why two runs differ: swaps one thing between them, and repeats a single step."""

"""Finds why two runs differ: swaps one input or model field, and repeats a single step."""

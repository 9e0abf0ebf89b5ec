"""Analyzes recordings, without using an engine or the recorder."""

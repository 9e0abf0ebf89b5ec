"""Explains recordings: every body as a tree of links, every step as a sum of named impulses."""

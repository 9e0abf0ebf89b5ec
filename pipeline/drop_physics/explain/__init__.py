"""Explain recordings: each body as a tree of links, each step as a sum of named impulses."""

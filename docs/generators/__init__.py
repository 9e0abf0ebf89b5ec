"""Generators of documents, called by `regenerate.py`."""

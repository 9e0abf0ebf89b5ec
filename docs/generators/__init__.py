"""What makes the generated documents: a file for each kind, called by `regenerate.py`."""

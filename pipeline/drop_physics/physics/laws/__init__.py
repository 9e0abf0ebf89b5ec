"""The laws by which engines step bodies."""

"""The integration rules by which engines step bodies."""

"""The judge: what a recording tells."""

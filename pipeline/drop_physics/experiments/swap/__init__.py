"""Find why two runs differ: swap one thing between them, and repeat a single step."""

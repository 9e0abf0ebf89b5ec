"""Output files: choose and check paths, and write files completely or not at all."""

"""A room for each engine: its worlds, its watching, its explanation."""

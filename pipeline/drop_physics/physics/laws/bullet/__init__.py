"""Bullet's step: what it adds to the sum, what it reports, and the flight of one body."""

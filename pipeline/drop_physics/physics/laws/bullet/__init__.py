"""Bullet's step: the terms of its sum, the forces that it reports, and the flight of one body."""

"""Bullet's step: the terms of its sum, the forces that it reports, and a single body's flight."""

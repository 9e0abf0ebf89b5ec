"""PyBullet: the world of a drop, and the recording and replay of any script's calls."""

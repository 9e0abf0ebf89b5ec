"""MuJoCo's step: the flight of one body, contact, and a tree from its own arrays."""

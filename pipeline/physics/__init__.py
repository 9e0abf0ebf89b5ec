"""Physics: what theory says, what Bullet's law says, and the world itself."""

"""Where outputs may go, and how they are written whole or not at all."""

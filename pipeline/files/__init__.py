"""Where outputs may go, and how they come to be whole."""

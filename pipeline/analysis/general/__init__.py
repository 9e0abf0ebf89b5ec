"""What can be said of any recording."""

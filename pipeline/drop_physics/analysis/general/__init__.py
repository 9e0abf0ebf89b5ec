"""What applies to any recording."""

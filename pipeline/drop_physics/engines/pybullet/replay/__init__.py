"""What makes the calls of a recorded script again, in the script's interpreter."""

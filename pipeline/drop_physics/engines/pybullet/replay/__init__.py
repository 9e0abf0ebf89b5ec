"""Replays a recorded script's calls, in the script's interpreter."""

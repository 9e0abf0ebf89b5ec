"""Runs a script with changes, and compares these runs with the unchanged one."""

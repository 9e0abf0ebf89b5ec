"""Imports states that another program saved, and compares them with MuJoCo's own steps."""

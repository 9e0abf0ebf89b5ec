"""Imports states that another simulator saved, and compares them with MuJoCo's own steps."""

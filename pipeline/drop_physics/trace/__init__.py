"""Recorded data of a script's simulations, for any engine: events, states, contacts, calls."""

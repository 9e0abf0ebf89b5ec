"""The recorded data of simulations, for any engine: events, states, contacts, calls."""

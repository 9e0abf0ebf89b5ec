"""What is recorded of simulations, for any engine: events, states, contacts, calls."""

"""The theory of a flight, and the discrete steps that engines take."""

"""The theory of a body's flight, and the discrete steps that engines take."""

"""What can be said of a flight with a theory: the error budget and all around it."""

"""The analysis of a flight with a theory: its error budget and all that follows."""

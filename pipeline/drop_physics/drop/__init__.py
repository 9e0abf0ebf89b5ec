"""The analysis of a drop with a known theory: its error terms, contact, rest and findings."""

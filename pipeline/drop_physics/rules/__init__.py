"""Answers: what a recording says to the question why a simulation did that, one file each."""

"""What a person or a script sees: results on standard output, the rest on standard error."""

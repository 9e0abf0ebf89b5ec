"""Output for a person or a script: results on standard output, the rest on standard error."""

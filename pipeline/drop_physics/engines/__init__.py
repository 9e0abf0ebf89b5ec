"""One folder for each engine: its worlds, the watching of scripts, and the explanation of steps."""

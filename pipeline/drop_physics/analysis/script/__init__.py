"""The analysis of the bodies of a script, whose release and floor are not described."""

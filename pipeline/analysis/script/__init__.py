"""What can be said of the bodies of a script, whose release and floor nobody has described."""

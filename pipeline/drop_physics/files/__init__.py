"""Places of outputs, and writing them whole or not at all."""

"""The recording: its schema, how it is written, how it is read back, how the viewer shows it."""

"""The analysis of recordings, which judges runs independently of engines and of the recorder."""

"""The analysis of recordings: the judge, independent of engines and of the recorder."""

"""Turns results of commands into reports, and reports into text, Markdown, HTML and JSON."""

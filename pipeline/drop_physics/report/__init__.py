"""Reports: what a verb found, as data, and its renderers."""

"""Reports: the results of verbs as data, and its renderers."""

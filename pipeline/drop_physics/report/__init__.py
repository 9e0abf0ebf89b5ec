"""Reports: results of verbs as data, and the renderers that display them."""

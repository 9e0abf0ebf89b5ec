"""The physics engines, a folder each: worlds for drops, watching of scripts, explaining steps."""

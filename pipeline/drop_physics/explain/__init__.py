"""Every body as a tree of links, every step of it as a sum of named impulses."""

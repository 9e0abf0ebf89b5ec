"""Rules, one file each, that answer from a recording why a simulation did what it did."""

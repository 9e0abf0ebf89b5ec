"""The rules, one file each: each finds a reason why a recorded simulation behaved as it did."""

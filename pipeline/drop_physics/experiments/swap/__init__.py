"""The reason why one run is not another: one thing is swapped, and one step is made."""

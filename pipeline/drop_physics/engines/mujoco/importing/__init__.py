"""States that another program has left on disk, held against MuJoCo's own steps."""

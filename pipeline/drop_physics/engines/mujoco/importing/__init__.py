"""States that another program has left on disk, compared with MuJoCo's own steps."""

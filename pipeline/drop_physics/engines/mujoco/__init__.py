"""MuJoCo: the world of a drop, and what watches and explains the steps of any script."""

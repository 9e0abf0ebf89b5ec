"""MuJoCo: the world of a drop, and the watching and explanation of any script's steps."""

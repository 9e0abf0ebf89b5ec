"""MuJoCo: the world of a drop, and the recording and explanation of any script's steps."""

"""The half of `drop record` that runs in the script's own interpreter, for any engine.

It needs Python 3.9 or later and the standard library. It imports nothing of drop but its
neighbours, the folders `watch` of the engines, so it can record in an environment that cannot have
drop: it is started by its path (`__main__`), and sends what it sees through a pipe (`pipe`) to the
other half.
"""

ENGINES = ("pybullet", "mujoco")
"""The engines' folders; `begin` of each one's `watch` takes the watch of the script, and the
changes of the run."""

"""The half of `drop record` that runs in the script's own interpreter, for any engine.

It needs Python 3.9 or later and the standard library. Of drop it imports only the folders `watch`
of the engines, so that it can record in an environment in which drop cannot be installed. It is
started by its path (`__main__`), and sends its observations through a pipe (`pipe`) to the other
half.
"""

ENGINES = ("pybullet", "mujoco")
"""The engines' folders. The function `begin` of each folder's `watch` gets the script's watch and
the changes of the run."""

"""The half of `drop record` that runs in the script's own interpreter, and watches its calls.

It needs Python 3.9 or later, the standard library, and the script's own pybullet. It imports
nothing else of drop, so it can record in an environment that cannot have drop: it is started by its
path (`__main__`), and sends what it sees through a pipe (`pipe`) to the other half.
"""

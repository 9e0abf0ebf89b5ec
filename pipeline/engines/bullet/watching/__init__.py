"""The half of `drop record` that runs in the script's own interpreter, and watches its calls.

It needs Python 3.9 or later, the standard library, and the pybullet that the script brings along.
It imports nothing else of drop, so that an environment which cannot have drop can be recorded: it
is started by its path (`__main__`), and what it sees goes down a pipe (`pipe`) to the other half.
"""

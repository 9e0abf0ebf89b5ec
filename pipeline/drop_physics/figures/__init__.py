"""Pictures for people, made from frames and tables alone: `gif` and `plot`.

Import the one you need; only `plot` loads matplotlib.
"""

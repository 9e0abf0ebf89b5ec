"""MuJoCo's step of one free body, and its resting depth, for the theory of a drop.

A recording of a drop holds states and contact points, no terms of its steps: an error's terms, and
that a sample follows from the one before to the last bit, come from this law. Steps of scripts are
replayed instead, and need none of it.
"""

"""MuJoCo's step of one free body, and its resting depth, for the theory of a drop.

The recording of a drop contains states and contact points, but no terms of its steps. This law
provides the terms of an error, and shows that each sample follows from the previous one to the last
bit. Steps of scripts are replayed instead, without this law.
"""

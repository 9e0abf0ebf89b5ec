"""Replays the recorded steps of a MuJoCo script, and explains each as a sum of impulses.

    M (u' - u) = h (gravity + bias + springs + … + push of each pair + friction of each pair)
                 + impulses that the integrator adds + remainder of the solver

per degree of freedom, where M is the mass matrix, u and u' are the velocities before and after, and
h is the timestep. The package runs in the interpreter that ran the script, because different
versions of MuJoCo compute different numbers. It needs Python 3.9 or later, numpy and mujoco, and
imports only `frames` and `memory` from the rest of drop.

`replay` makes the steps, and `copied` copies the forces and matrices that MuJoCo computes for them.
For a batch of steps, `forces`, `constraints` and `integrators` then assign the impulses to causes,
and `summed` adds them up.
"""

"""Replays the recorded steps of a MuJoCo script, and explains each as a sum of impulses.

    M (u' - u) = h (gravity + bias + springs + … + push of each pair + friction of each pair)
                 + what the integrator adds + what the solver left

per degree of freedom, where M is the mass matrix, u and u' are the velocities before and after, and
h is the timestep. It runs in the interpreter that ran the script, because MuJoCo's numbers are only
the same within a version: Python 3.9 or later, numpy and mujoco, nothing else of ours.

`replay` takes the steps, `copied` keeps what MuJoCo computed for them, and once enough are there,
`forces`, `constraints` and `integrators` name the impulses of all at once; `summed` adds them up.
"""

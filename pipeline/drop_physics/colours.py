"""Colours: each quantity has the same colour in plots and in the viewer.

The palette is that of Okabe and Ito, which colour-blind readers can distinguish.
"""

SIMULATED = "#0072b2"
FREE_FALL = "#8a8f98"
DAMPED_FALL = "#56b4e9"
GOLDEN = "#c3c8cf"
"""Colour of the golden recording, shown beside another recording."""
TOTAL = "#222222"
TOTAL_IN_VIEWER = "#8f5fd0"
"""Colour of the total in the viewer, legible on both its light and its dark theme."""
TIMESTEP = "#d55e00"
DAMPING = "#009e73"
INTERACTION = "#cc79a7"
ROUNDING = "#e69f00"
TERMS = {
    "timestep": TIMESTEP,
    "damping": DAMPING,
    "interaction": INTERACTION,
    "rounding": ROUNDING,
}
"""The error's terms with their colours, in the order used everywhere."""
ENGINES = {"bullet": SIMULATED, "mujoco": "#ee6677"}
"""Colours of the engines, from Paul Tol's bright palette; no error term has one of these."""
KINETIC = "#d55e00"
ROTATION = "#cc79a7"
POTENTIAL = "#56b4e9"
SEGMENTS = {
    "flight": "#56b4e9",
    "contact": "#e69f00",
    "driven": "#cc79a7",
    "constrained": "#0072b2",
    "pushed": "#009e73",
    "set": "#f0e442",
    "jointed": "#8a8f98",
    "still": "#4b5563",
    "unexplained": "#d55e00",
}
"""Colours of the segments of a body's samples, such as flight and contact."""
CAUSES = {
    "motors": "#cc79a7",
    "contacts": "#e69f00",
    "rolling": "#b8860b",
    "applied": "#009e73",
    "constraints": "#0072b2",
    "damping": "#56b4e9",
    "joint damping": "#d55e00",
    "stops": "#a0522d",
    "set": "#b5a900",
    "clamp": "#aa3377",
    "integrator": "#8a8f98",
    "remainder": "#ee6677",
    "spring": "#117733",
    "fluid": "#88ccee",
    "friction loss": "#882255",
    "gravity compensation": "#44aa99",
    "tendon": "#999933",
    "adhesion": "#ddcc77",
    "passive callback": "#661100",
    "joint force range": "#aa3377",
    "solver": "#bbbbbb",
    "another engine": "#000000",
}
"""Colours of the causes that change a body's energy."""
JOINTS = ("#d55e00", "#56b4e9", "#009e73", "#cc79a7", "#e69f00", "#8f5fd0")
"""Colours of joints that are drawn side by side."""

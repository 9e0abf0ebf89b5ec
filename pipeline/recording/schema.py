"""What a recording holds, and under which names: the one place where they stand.

A recording has two timelines: `sim_step`, the integer key that samples are joined on, and
`sim_time`, the same step in simulated time (whole nanoseconds, for looking at). The numbers that
everything is computed from are the float64 scalars under `state/`; the transforms under `world/`
are float32, for looking at.
"""

from __future__ import annotations

APPLICATION_ID = "drop"
SCHEMA_VERSION = 1

STEP_TIMELINE = "sim_step"
TIME_TIMELINE = "sim_time"

# -- what is measured: entity path -> the columns of its scalars ----------------------------------

STATE: dict[str, tuple[str, ...]] = {
    "state/position": ("x_m", "y_m", "z_m"),
    "state/orientation": ("qx", "qy", "qz", "qw"),
    "state/linear_velocity": ("vx_m_s", "vy_m_s", "vz_m_s"),
    "state/angular_velocity": ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
    "state/contact": ("contact_points", "contact_distance_m", "contact_force_n"),
}
"""World axes; orientation is a quaternion x, y, z, w. The contact is that of the step which led to
the sample, its distance nan where there is none."""

LINKS = "state/links"
LINK_STATE = (*STATE["state/position"], *STATE["state/orientation"],
    *STATE["state/linear_velocity"], *STATE["state/angular_velocity"])  # fmt: skip
"""What is recorded of each further link of a body with joints: of its own centre of mass."""


def state_entities(links: int) -> dict[str, tuple[str, ...]]:
    """Return the columns of each entity under `state/` for a body with so many further links."""
    if not links:
        return STATE
    of_links = tuple(f"link{n}_{column}" for n in range(links) for column in LINK_STATE)
    return STATE | {LINKS: of_links}


def state_columns(links: int) -> tuple[str, ...]:
    """Return the names of all columns of the state, in the order of its rows."""
    return tuple(column for columns in state_entities(links).values() for column in columns)


# -- what is drawn --------------------------------------------------------------------------------

WORLD = "world"
FLOOR = "world/floor"
BOX = "world/box"
CAMERA = "world/camera"
IMAGE = "world/camera/image"
TRAIL = "world/trail"
"""Where the body was, at most some forty points of it."""
ABOUT = "about"

POSE_RESOLUTION = 1e-4
"""A box that moved by less [m], or turned by as much of a quaternion, looks the same."""
HEIGHT_RESOLUTION_M = 1e-9
"""A height curve that stays within this [m] is level."""

HEIGHT = "height"
HEIGHT_SIMULATED = "height/simulated"
HEIGHT_FREE_FALL = "height/free_fall"
HEIGHT_DAMPED_FALL = "height/damped_fall"

# -- what it was made with: properties ------------------------------------------------------------

SCENARIO_PROPERTY = "scenario"
ENGINE_PROPERTY = "engine"
CAMERA_PROPERTY = "camera"
RECORDING_PROPERTY = "recording"
"""Schema version, numbers of samples and frames, digests of state, inputs and frames: written last.
A recording without it was never finished."""

INPUT_PROPERTIES = (SCENARIO_PROPERTY, ENGINE_PROPERTY, CAMERA_PROPERTY)
PROPERTIES = (*INPUT_PROPERTIES, RECORDING_PROPERTY)

# -- the layer that `analyze` adds, under the same recording id -----------------------------------

ERROR_TERMS = ("total", "timestep", "damping", "interaction", "rounding")
ERROR = "error"
"""Metres: the numbers."""
ERROR_MM = "error_mm"
"""The same in millimetres: the curves, because the viewer cannot scale what it shows."""
ENERGY = "energy"
ENERGY_RESOLUTION = 1e-10
"""An energy curve that stays within this share of the largest energy is level."""
EVENTS = "events"
FINDINGS = "findings"

# -- what they are, in words ----------------------------------------------------------------------

CAMERA_SAYS = {
    "distance_m": "from the camera to its target",
    "far_m": "nothing farther away is drawn",
    "near_m": "nothing nearer is drawn",
    "pitch_deg": "angle above (positive) or below the horizontal plane that it looks along",
    "roll_deg": "turn about its own axis",
    "target_m": "what it looks at: x, y, z",
    "vertical_fov_deg": "vertical field of view",
    "yaw_deg": "turn about the vertical",
}
"""What no option says of the camera."""
TABLE_SAYS = {
    "step": "number of the sample",
    "time_s": "step × timestep",
    "phase": "falling, contact or rest",
    "simulated_m": "height of the centre in the recording",
    "free_fall_m": "the same by theory, without air; from the first contact on at least the rest "
    "height",
    "damped_fall_m": "the same through Bullet's damping, in continuous time",
    "error_m": "simulated minus free fall; the next four add up to it",
    "timestep_m": "what semi-implicit Euler does, without damping",
    "damping_m": "what damping does, in continuous time",
    "interaction_m": "what the two do to each other",
    "rounding_m": "what double precision leaves",
    "kinetic_linear_j": "energy of the motion",
    "kinetic_angular_j": "energy of the rotation",
    "potential_j": "energy of the height above z = 0",
    "energy_j": "their sum",
}
"""The columns of the table that `analyze` makes, a row per sample."""

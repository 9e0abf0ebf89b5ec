"""Names of a recording's contents, defined only here.

A recording has two timelines: `sim_step`, the integer key that samples are joined on, and
`sim_time`, the same step in simulated time (whole nanoseconds, for display). Everything is computed
from the float64 lists of `state` and `contacts`; the transforms under `world/` are float32, for
display.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drop_physics.trace.states import BASE_STATE, CONTACT

APPLICATION_ID = "drop"
SCHEMA_VERSION = 8

STEP_TIMELINE = "sim_step"
TIME_TIMELINE = "sim_time"
LONGEST_S = 9e9
"""Largest time on it [s]: the viewer has nanoseconds in 64 bits, which are 292 years."""
CALL_TIMELINE = "call"
"""The timeline of a script's recording that counts the calls before."""

# -- what is measured -----------------------------------------------------------------------------


class Table(NamedTuple):
    """Rows of named numbers, and their place in a recording."""

    entity: str
    """Has a row per step: lists with the values of that step's rows one after the other."""
    kind: np.dtype[np.void]
    """The rows; their fields other than the step are the entity's components."""

    @property
    def components(self) -> tuple[str, ...]:
        """The fields that are lists of the entity."""
        return tuple(name for name in self.kind.names or () if name != "step")


STATES = Table("state", BASE_STATE)
"""Every base that can move, at every step."""

CONTACTS = Table("contacts", CONTACT)
"""Every contact point; a step without any has no row."""

TABLES = {table.entity: table for table in (STATES, CONTACTS)}

# -- what a script did -----------------------------------------------------------------------------

BODIES = "bodies"
"""A row whenever a body appears, disappears or looks different: what it is."""
SURFACES = "surfaces"
"""A row per mesh that is held as its convex hull, where it is hollow: the surface of its file."""
SET = "set"
"""A row per body that calls have moved: its state before the next step."""
DYNAMICS = "dynamics"
"""A row per body when they change: mass, inertia, friction … of base and links."""
SETTINGS = "engine"
"""A row when they change: timestep, gravity … of the engine."""
SOLVER = "solver"
"""A row per simulation whose contact solver stopped before it converged, written at its end."""
READINGS = "readings"
"""A row per place that reads, written at the end: function, file, line, what it read and when."""
SITES = "sites"
"""A row per place that calls a function of the engine: function, file, line, form of arguments."""
CALLS = "calls"
"""A row per step with calls: the site of each, and all their numbers."""
RAISED = "calls/raised"
"""A row per call that failed: its error."""
LOG = "calls/log"
"""Calls as text, for reading: the first of each site."""
JOINTS = "joints"
"""Entities of bodies' `position`, `velocity` and `effort` lie below it: a series per joint,
float64, a row per step."""
OF_JOINTS = ("position", "velocity", "effort")
TARGET, LIMIT = "target", "limit"
"""Rows when a call changes one, beside them: targets, with target velocities and torques; largest
forces of motors, with modes and gains."""
CONSTRAINTS = "constraints"
"""Entities of constraints' forces lie below it: a row per step."""
CONSTRAINT = "constraint"
"""The component beside them with the constraint's id: when it is gone, others use its entity."""

CONTROLS = "controls"
"""Controls of actuators lie below it, by simulation: a row per step where they change."""
MODELS = "models"
"""A row per part of a compiled model that was stepped: with it and `steps`, the engine can take
each step again."""
STEPS = "steps"
"""A row per piece of a simulation's steps: the full state before each of them, and its inputs."""
IMPULSES = "impulses"
"""Impulses in each step lie below it, by simulation, where the engine has computed it again."""
CAUSES = "causes"
"""A row per cause of these: what it is, and which degrees of freedom of which body it acts on."""
PAIRS = "pairs"
"""A row per two links that touch: their coefficient of friction."""

WARNINGS = "warnings"
"""A row per kind of warning of the engine, written at the end: how often, and when."""
EQUALITIES = "equalities"
"""A row per two links that are held together from the beginning on."""
EPISODES = "episodes"
"""A row per episode that an environment of gymnasium's has ended: how, why, length and return."""
SENSORS = "sensors"
"""A row per sensor of a model, written at the end: what it read."""

JSON = "json"
"""The column of their rows."""
TOLD = (
    *(BODIES, SURFACES, SET, DYNAMICS, SETTINGS, SOLVER, READINGS, SITES, RAISED, CAUSES, PAIRS),
    *(WARNINGS, EQUALITIES, EPISODES, SENSORS),
)
"""Entities with rows of JSON, covered by one digest."""

HAPPENED = (STATES.entity, CONTACTS.entity, f"{JOINTS}/", SET, CALLS, "camera/")
"""Beginnings of the entities without which nothing was recorded."""

# -- what is drawn --------------------------------------------------------------------------------

WORLD = "world"
FLOOR = "world/floor"
BOX = "world/box"
CAMERA = "world/camera"
IMAGE = "world/camera/image"
TRAIL = "world/trail"
"""Path of the body, in about forty points."""
ABOUT = "about"

COLLISIONS = "collisions"
"""Collision shapes of links lie below it; hidden, except for bodies that a finding names them for.
"""
POSE_RESOLUTION = 1e-5
"""Smaller motions [m], and smaller changes of a quaternion, are invisible."""
HEIGHT_RESOLUTION_M = 1e-9
"""A height curve that stays within this [m] is level."""

CONTACT_POINTS = "world/contacts"
"""Contact points, and the forces there as arrows; of a script, thinned."""

GOLDEN = "golden"
"""Part of `world` and `height` for the golden recording shown beside a recording; never in a
recording itself."""

HEIGHT = "height"
HEIGHT_SIMULATED = "height/simulated"
HEIGHT_FREE_FALL = "height/free_fall"
HEIGHT_DAMPED_FALL = "height/damped_fall"

FOR_LOOKING = (WORLD, COLLISIONS, f"{HEIGHT}/", LOG)
"""Beginnings of the entities from which a script's recording computes nothing."""

# -- the inputs: properties -----------------------------------------------------------------------

SCENARIO_PROPERTY = "scenario"
ORIGIN_PROPERTY = "origin"
"""Properties of the script: its name, the digest of its text, its arguments."""
IMPORTED = "imported"
"""The kind of an origin whose states another program has made."""
BLOCK = "a block of Python"
"""Recorded where a script has its name."""
ENGINE_PROPERTY = "engine"
CAMERA_PROPERTY = "camera"
RECORDING_PROPERTY = "recording"
"""Schema version, numbers of samples and frames, digests of state, contacts, inputs and frames:
written last. A recording without it is unfinished."""

INPUT_PROPERTIES = (ORIGIN_PROPERTY, SCENARIO_PROPERTY, ENGINE_PROPERTY, CAMERA_PROPERTY)
PROPERTIES = (*INPUT_PROPERTIES, RECORDING_PROPERTY)
"""All that a recording may have: of a script its origin, of a drop the rest."""

# -- the layer that `analyze` adds, under the same recording id -----------------------------------

ERROR = "error"
"""Metres: the numbers."""
ERROR_MM = "error_mm"
"""The same in millimetres: the curves, because the viewer cannot scale them."""
ENERGY = "energy"
ENERGY_RESOLUTION = 1e-10
"""An energy curve that stays within this share of the largest energy is level."""
SEGMENTS = "segments"
"""The kind of each sample of a script's bodies, as states."""
PANELS = "panels"
"""Curves of joints, friction and energy by cause of a script, as its plot has them."""
EVENTS = "events"
FINDINGS = "findings"
EXPLAINED = "explained"
"""The digests of what was explained of a recording after it was made."""

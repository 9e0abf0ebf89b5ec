"""Defines the names of entities, properties and components in a recording.

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
"""Largest time on the time axis [s]: the viewer has nanoseconds in 64 bits, which are 292 years."""
CALL_TIMELINE = "call"
"""Timeline of a script's recording that counts the calls before each row."""

# -- what is measured -----------------------------------------------------------------------------


class Table(NamedTuple):
    """A table: rows of named numbers, and the entity that stores them."""

    entity: str
    """Entity with one row per step, which stores a table's rows as lists."""
    kind: np.dtype[np.void]
    """Type of the rows; its fields, other than the step, are the entity's components."""

    @property
    def components(self) -> tuple[str, ...]:
        """The fields that are stored as the entity's components."""
        return tuple(name for name in self.kind.names or () if name != "step")


STATES = Table("state", BASE_STATE)
"""State of every base that can move, at every step."""

CONTACTS = Table("contacts", CONTACT)
"""Every contact point; a step without any has no row."""

TABLES = {table.entity: table for table in (STATES, CONTACTS)}

# -- what a script did -----------------------------------------------------------------------------

BODIES = "bodies"
"""Entity with a row of JSON whenever a body appears, disappears or looks different: its
description."""
SURFACES = "surfaces"
"""Entity with a row for each hollow mesh that the engine replaces by its convex hull: the surface
in the mesh file."""
SET = "set"
"""Entity with a row whenever calls have set a body's state: the state before the next step."""
DYNAMICS = "dynamics"
"""Entity with a row whenever properties of a body change: mass, inertia, friction … of base and
links."""
SETTINGS = "engine"
"""Entity with a row whenever settings of the engine change: timestep, gravity …"""
SOLVER = "solver"
"""Entity with a row for each simulation whose contact solver stopped before it converged, written
at the end."""
READINGS = "readings"
"""Entity with a row for each script line that reads values, written at the end: function, file,
line, subjects, and number of readings."""
SITES = "sites"
"""Entity with a row for each call site of an engine function: function, file, line, structure of
the arguments."""
CALLS = "calls"
"""Entity with a row for each step with calls: the call site of each, and all numeric arguments."""
RAISED = "calls/raised"
"""Entity with a row for each failed call: the error."""
LOG = "calls/log"
"""Entity with the first calls of each call site as readable text."""
JOINTS = "joints"
"""Parent of the entities of bodies' `position`, `velocity` and `effort`: one series per joint,
float64, a row per step."""
OF_JOINTS = ("position", "velocity", "effort")
TARGET, LIMIT = "target", "limit"
"""Names of entities beside these, with a row whenever a call changes a value: position, velocity
and torque targets; and force limits of motors, with modes and gains."""
CONSTRAINTS = "constraints"
"""Parent of the entities of constraint forces: a row per step."""
CONSTRAINT = "constraint"
"""Component with the constraint's id beside the forces: after a constraint is removed, others reuse
its entity."""

CONTROLS = "controls"
"""Parent of the entities with the controls of actuators, by simulation: a row for each step at
which they change."""
MODELS = "models"
"""Entity with a row for each part of a compiled model: with the model and `steps`, the engine can
repeat each step."""
STEPS = "steps"
"""Entity with a row for each batch of a simulation's steps: the full state before each step, and
the inputs."""
IMPULSES = "impulses"
"""Parent of the entities with the impulses in each step, by simulation, if the engine has repeated
the step."""
CAUSES = "causes"
"""Entity with a row for each cause of impulses: its kind, its body, and the degrees of freedom on
which it acts."""
PAIRS = "pairs"
"""Entity with a row for each pair of links that touch: their friction coefficient."""

WARNINGS = "warnings"
"""Entity with a row for each kind of engine warning, written at the end: how often, and when."""
EQUALITIES = "equalities"
"""Entity with a row for each pair of links that are connected from the beginning."""
EPISODES = "episodes"
"""Entity with a row for each finished episode of a gymnasium environment: how and why it ended,
length and return."""
SENSORS = "sensors"
"""Entity with a row for each sensor of a model, written at the end: the measured values."""
ARRAY_USES = "array_uses"
"""Entity with a row for each script line that uses an array to another effect than it seems to,
written at the end."""

JSON = "json"
"""Name of the column that stores rows of JSON."""
TOLD = (
    *(BODIES, SURFACES, SET, DYNAMICS, SETTINGS, SOLVER, READINGS, SITES, RAISED, CAUSES, PAIRS),
    *(WARNINGS, EQUALITIES, EPISODES, SENSORS, ARRAY_USES),
)
"""Entities with rows of JSON, which share one digest."""

HAPPENED = (STATES.entity, CONTACTS.entity, f"{JOINTS}/", SET, CALLS, "camera/")
"""Prefixes of entities; a recording without any of them has recorded nothing."""

# -- what is drawn --------------------------------------------------------------------------------

WORLD = "world"
FLOOR = "world/floor"
BOX = "world/box"
CAMERA = "world/camera"
IMAGE = "world/camera/image"
TRAIL = "world/trail"
"""Path of the dropped body, in about forty points."""
ABOUT = "about"

COLLISIONS = "collisions"
"""Parent of the collision shapes of links, which are hidden except for bodies that a finding
concerns."""
POSE_RESOLUTION = 1e-5
"""Resolution of drawn poses [m], and of quaternions: smaller changes are invisible and not written.
"""
HEIGHT_RESOLUTION_M = 1e-9
"""A height curve that stays within this range is drawn level [m]."""

CONTACT_POINTS = "world/contacts"
"""Contact points, and contact forces as arrows; thinned for a script."""

GOLDEN = "golden"
"""Name below `world` and `height` for a golden recording shown beside another; never stored in a
recording."""

HEIGHT = "height"
HEIGHT_SIMULATED = "height/simulated"
HEIGHT_FREE_FALL = "height/free_fall"
HEIGHT_DAMPED_FALL = "height/damped_fall"

FOR_LOOKING = (WORLD, COLLISIONS, f"{HEIGHT}/", LOG)
"""Prefixes of the entities that are only displayed: nothing is computed from them."""

# -- the inputs: properties -----------------------------------------------------------------------

SCENARIO_PROPERTY = "scenario"
ORIGIN_PROPERTY = "origin"
"""Name of the property that describes the script: its name, the digest of its text, its
arguments."""
IMPORTED = "imported"
"""Kind of origin for states that another program computed."""
BLOCK = "a block of Python"
"""Name that is recorded for a block of Python, which has no script."""
ENGINE_PROPERTY = "engine"
CAMERA_PROPERTY = "camera"
RECORDING_PROPERTY = "recording"
"""Name of the property that is written last: schema version, numbers of samples and frames, digests
of state, contacts, inputs and frames. A recording without it is unfinished."""

INPUT_PROPERTIES = (ORIGIN_PROPERTY, SCENARIO_PROPERTY, ENGINE_PROPERTY, CAMERA_PROPERTY)
PROPERTIES = (*INPUT_PROPERTIES, RECORDING_PROPERTY)
"""All properties that a recording may have: the origin for a script, the others for a drop."""

# -- the layer that `analyze` adds, under the same recording id -----------------------------------

ERROR = "error"
"""Entity of the error in metres, for computing."""
ERROR_MM = "error_mm"
"""Entity of the error in millimetres, for curves, because the viewer cannot scale them."""
ENERGY = "energy"
ENERGY_RESOLUTION = 1e-10
"""An energy curve that stays within this share of the largest energy is drawn level."""
SEGMENTS = "segments"
"""Entity with the segment of each sample of a script's bodies, as states of the viewer."""
PANELS = "panels"
"""Entity with a script's curves of joints, friction, and energy by cause, as in its plot."""
EVENTS = "events"
FINDINGS = "findings"
EXPLAINED = "explained"
"""Name of the property with the digests of impulses that were computed after recording."""

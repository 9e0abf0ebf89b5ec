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
"""Timeline of a script's recording that counts the calls made before."""

# -- what is measured -----------------------------------------------------------------------------


class Table(NamedTuple):
    """A table: rows of named numbers, and the entity that stores them."""

    entity: str
    """Entity with one row per step, which has lists of the table rows' values."""
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
"""One row whenever a body appears, disappears or looks different: its description."""
SURFACES = "surfaces"
"""One row per hollow mesh that the engine replaces by its convex hull: the surface of its file."""
SET = "set"
"""One row per body that calls have moved: its state before the next step."""
DYNAMICS = "dynamics"
"""One row per body whenever they change: mass, inertia, friction … of base and links."""
SETTINGS = "engine"
"""One row whenever they change: timestep, gravity … of the engine."""
SOLVER = "solver"
"""One row per simulation whose contact solver stopped before it converged, written at its end."""
READINGS = "readings"
"""One row per call site that reads, written at the end: function, file, line, what was read and
when."""
SITES = "sites"
"""One row per call site of an engine function: function, file, line, structure of the arguments."""
CALLS = "calls"
"""One row per step that has calls: the call site of each, and all numeric arguments."""
RAISED = "calls/raised"
"""One row per call that failed: its error."""
LOG = "calls/log"
"""Calls as readable text: the first of each call site."""
JOINTS = "joints"
"""Parent of the entities of bodies' `position`, `velocity` and `effort`: one series per joint,
float64, a row per step."""
OF_JOINTS = ("position", "velocity", "effort")
TARGET, LIMIT = "target", "limit"
"""Entities beside these, with a row when a call changes a value: targets, with target velocities
and torques; largest forces of motors, with modes and gains."""
CONSTRAINTS = "constraints"
"""Parent of the entities of constraint forces: a row per step."""
CONSTRAINT = "constraint"
"""Component beside the forces with the constraint's id: once it is removed, others reuse its
entity."""

CONTROLS = "controls"
"""Parent of the controls of actuators, by simulation: a row per step at which they change."""
MODELS = "models"
"""One row per part of a compiled model that was stepped: with it and `steps`, the engine can repeat
each step."""
STEPS = "steps"
"""One row per batch of a simulation's steps: the full state before each step, and its inputs."""
IMPULSES = "impulses"
"""Parent of the impulses in each step, by simulation, where the engine has repeated the step."""
CAUSES = "causes"
"""One row per cause of impulses: what it is, and the body and degrees of freedom it acts on."""
PAIRS = "pairs"
"""One row per pair of links that touch: their coefficient of friction."""

WARNINGS = "warnings"
"""One row per kind of engine warning, written at the end: how often, and when."""
EQUALITIES = "equalities"
"""One row per pair of links that are connected from the beginning on."""
EPISODES = "episodes"
"""One row per finished episode of a gymnasium environment: how and why it ended, length and
return."""
SENSORS = "sensors"
"""One row per sensor of a model, written at the end: what it measured."""

JSON = "json"
"""Name of the column that stores rows of JSON."""
TOLD = (
    *(BODIES, SURFACES, SET, DYNAMICS, SETTINGS, SOLVER, READINGS, SITES, RAISED, CAUSES, PAIRS),
    *(WARNINGS, EQUALITIES, EPISODES, SENSORS),
)
"""Entities with rows of JSON, which share one digest."""

HAPPENED = (STATES.entity, CONTACTS.entity, f"{JOINTS}/", SET, CALLS, "camera/")
"""Prefixes of the entities without any of which nothing was recorded."""

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
"""Motions [m], and changes of a quaternion, below this are invisible and not drawn."""
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
"""Recorded in place of a script's name for a block of Python."""
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
"""Entity of the kind of each sample of a script's bodies, as states."""
PANELS = "panels"
"""Entity of a script's curves of joints, friction and energy by cause, as in its plot."""
EVENTS = "events"
FINDINGS = "findings"
EXPLAINED = "explained"
"""Name of the property with the digests of what was explained after recording."""

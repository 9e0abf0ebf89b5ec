"""Write the reference of the recording format, from a recording made for the purpose."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import polars as pl
import pyarrow as pa
from drop_physics import Camera, Scenario, analyze, simulate
from drop_physics.explain.decomposition import TERMS
from drop_physics.recording import rrd, schema
from drop_physics.trace.tables import columns_of

from generators.typed import run_python

UNITS = {
    "m_s2": "m/s²", "kg_m2": "kg m²", "m_s": "m/s", "rad_s": "rad/s", "m": "m", "s": "s", "n": "N",
    "j": "J", "kg": "kg", "px": "px", "deg": "°",
}  # fmt: skip
TYPES = {"double": "float64", "float": "float32"}
"""Arrow's type name -> numpy's."""

MEASURED = {
    "state": {
        "body": "id of the body: 0 for the dropped one; in a script's recording as in `bodies`",
        "position_m": "the centre of mass of the base, world axes",
        "orientation": "a quaternion: x, y, z, w",
        "velocity_m_s": "world axes",
        "spin_rad_s": "angular velocity, world axes",
    },
    "contacts": {
        "body_a": "id of the first body: 0 for the dropped one, 1 for the floor",
        "link_a": "index of its link",
        "body_b": "id of the other body",
        "link_b": "index of its link",
        "position_a_m": "the point on a, world axes",
        "position_b_m": "the point on b",
        "normal": "from b to a",
        "distance_m": "between the two points; negative where a and b penetrate each other",
        "normal_force_n": "on a, along the normal",
        "friction_1_n": "on a, along the first direction",
        "friction_1_direction": "world axes",
        "friction_2_n": "on a, along the second direction",
        "friction_2_direction": "world axes",
    },
}
CURVES = {
    schema.HEIGHT_SIMULATED: "height of the body's centre",
    schema.HEIGHT_FREE_FALL: "free fall, without air; stops at the floor",
    schema.HEIGHT_DAMPED_FALL: "a fall through Bullet's damping, in continuous time",
}
DRAWN = {
    schema.WORLD: "z is up",
    f"{schema.FLOOR}/base/0": "the floor, its surface at z = 0",
    f"{schema.BOX}/base": "the body's pose; below it a robot's links, each in its parent's frame",
    f"{schema.BOX}/base/0": "the body's shape",
    schema.TRAIL: "the body's path, as about forty points",
    schema.CAMERA: "the camera: its lens and pose",
    schema.IMAGE: "a frame, a PNG",
    schema.ABOUT: "a description of this recording",
}
HAPPENED = {
    schema.BODIES: "a body is added, removed, or changes its looks: its links, joints with axes, "
    "limits and frames, shapes, collision shapes and hulls, properties in its file",
    schema.SURFACES: "a body is added with a hollow mesh, which the engine replaces by its convex "
    "hull: the surface in its file; equal ones are stored once, then as a digest",
    schema.DYNAMICS: "the engine reports other properties of a body's links: mass, inertia, "
    "friction …",
    schema.SETTINGS: "the engine reports other settings: timestep, gravity, solver …",
    schema.SET: "a call sets the state of a body between two steps, and changes it",
    schema.READINGS: "a line of the script reads the simulation: function, file, line, arguments, "
    "what it reads, in which steps and how often (if `exact` is false, estimated from one of 61 "
    "steps); for images the matrices of the first one",
    schema.SITES: "a line of the script calls the engine: function, file, line, and arguments, "
    "with `{}` for each number",
    schema.RAISED: "a call raises an error",
    schema.CAUSES: "a cause of impulses on a body appears: its kind, its name, and the "
    "degrees of freedom on which it acts (spin and velocity of the base, then the joints' "
    "rates); MuJoCo only",
    schema.PAIRS: "two links touch: their coefficient of friction; MuJoCo only",
    schema.ARRAY_USES: "the run ends, for a line of the script that keeps an array without a copy, "
    "reads it out of date, writes it to no effect, leaves a force in it, or comes after an edit of "
    "the model that leaves out what depends on it; MuJoCo only",
    schema.SOLVER: "a simulation ends: how often the solver used all its iterations while the "
    "last one still changed a velocity by over 0.01 m/s or rad/s; counted in every eighth step, "
    "while up to 64 bodies move",
}
SAMPLED = {
    f"{schema.JOINTS}/BODY/position": "[rad] or [m]: a named series per joint, a row per step",
    f"{schema.JOINTS}/BODY/velocity": "[rad/s] or [m/s]",
    f"{schema.JOINTS}/BODY/effort": "of the motors [N m] or [N]",
    f"{schema.JOINTS}/BODY/{schema.TARGET}": "the targets that calls set, a row when one "
    "changes: positions; beside them `velocity` and `torque`",
    f"{schema.JOINTS}/BODY/{schema.LIMIT}": "likewise the largest effort of each motor; beside it "
    "`mode` (0 velocity, 1 torque, 2 position, 3 PD), `kp` and `kd`",
    f"{schema.CONSTRAINTS}/CLIENT_ID": "the forces of a constraint [N] or [N m], a row per step; "
    "after its removal those of a similar constraint, whose id is in `constraint`",
    f"{schema.CONTROLS}/CLIENT": "the controls of actuators in the steps that led to samples, a "
    "row when one changes; MuJoCo only",
    schema.MODELS: "a compiled model that was stepped, as MuJoCo saves it, in parts of 1 MB: "
    "`json` has its index, engine, version and digest; `data` the bytes, compressed by zlib",
    schema.STEPS: "a row for each batch of a simulation's steps: with the model and the state "
    "before each step, MuJoCo can replay them; `json` says what the `numbers` are (those that are "
    "not in the series of joints), and `at` the steps of numbers that only some steps have",
    f"{schema.IMPULSES}/CLIENT": "the impulses in the step that led to a sample, MuJoCo only: "
    f"lists of `cause` (indices into `{schema.CAUSES}`) and `impulse` [N s or N m s], one after "
    "the other; `status`: 0 if they are the step's sum, else the reason why not; `remainder`: the "
    "rest, relative to the largest impulse",
    schema.CALLS: "a row per step with calls: lists of `site`, of all `numbers` one after the "
    "other, of `result`, and how many calls came `after` the first",
    f"{schema.LOG}": "the first calls of each site as text",
    "camera/N/image": "what `getCameraImage` returned",
}
"""Further entities of a recording that has joints, constraints or a script."""

TABLE_SAYS = {
    "step": "index of the sample",
    "time_s": "step × timestep",
    "phase": "falling, contact or rest",
    "simulated_m": "height of the centre in the recording",
    "free_fall_m": "the same by theory, without air; from the first contact on, at least the rest "
    "height",
    "damped_fall_m": "the same through Bullet's damping, in continuous time",
    "error_m": "simulated minus free fall; the sum of the next four, but for the rounding of "
    "`free_fall_m` to a float64",
    "timestep_m": "from semi-implicit Euler, without damping",
    "damping_m": "from damping, in continuous time",
    "interaction_m": "from their interaction",
    "rounding_m": "from double-precision rounding",
    "kinetic_linear_j": "energy of translation",
    "kinetic_angular_j": "energy of rotation",
    "potential_j": "energy of the height above z = 0",
    "energy_j": "their sum",
}
"""Descriptions of the columns in `analyze`'s table, which has a row per sample."""
LAYER = {
    "error_m": f"{schema.ERROR}/total",
    **{f"{term}_m": f"{schema.ERROR}/{term}" for term in TERMS},
    "kinetic_linear_j": f"{schema.ENERGY}/kinetic",
    "kinetic_angular_j": f"{schema.ENERGY}/rotation",
    "potential_j": f"{schema.ENERGY}/potential",
    "energy_j": f"{schema.ENERGY}/total",
}
"""Column of `analyze`'s table -> its curve in the layer."""

_HEAD = f"""# What is in a recording

*Generated by `python docs/regenerate.py` from a recording and `recording/schema.py`; this is
schema version {schema.SCHEMA_VERSION}. Any [Rerun](https://rerun.io) tool reads it.*

`drop simulate` writes `RUN.rrd`. `drop analyze` writes `RUN.analysis.rrd`, a layer with the same
recording id: opened together they are one recording. Units are SI, world axes are x, y, z with z
up, and every sample is the state *before* a step: sample 0 is the release.

## Timelines

| timeline | type | meaning |
| --- | --- | --- |
| `{schema.STEP_TIMELINE}` | sequence, int64 | index of the step: the key of the samples |
| `{schema.TIME_TIMELINE}` | duration, int64 ns | step × timestep, in whole nanoseconds |
| `{schema.CALL_TIMELINE}` | sequence, int64 | for a script: number of earlier calls |
"""

_STATE = f"""## State

Entity `{schema.STATES.entity}`, a row per step; every number is computed from these and the
contacts. A component is a list with the values of each body whose base can move, one after the
other. Read back, a body is a row of the table `states` with the columns named here.
"""
_CONTACTS = f"""## Contacts

Entity `{schema.CONTACTS.entity}`, a row per step that has any: what `getContactPoints` returned
after the step that led to the sample. A component is a list with the values of each contact point,
one after the other. Read back, a point is a row of the table `contacts`.
"""

_PROPERTIES = f"""## Properties

Under `__properties/`, once. Of a drop: `{schema.SCENARIO_PROPERTY}` and
`{schema.ENGINE_PROPERTY}`, whose names, units and meanings are those of the keys in
[JSON](json.md#drop-analyze), and `{schema.CAMERA_PROPERTY}`. Of a script:
`{schema.ORIGIN_PROPERTY}`, its name, arguments and digest. Values left to the engine are absent.
`{schema.RECORDING_PROPERTY}` comes last: the schema version, the numbers of samples and frames, how
the run ended, and SHA-256 digests of everything that numbers are computed from.
"""
_LAYER = f"""## The layer of `drop analyze`, and its `--table`

One row per sample of a drop. Error terms are null where the law of free flight does not hold. The
layer also has the errors in millimetres (`{schema.ERROR_MM}/`), `{schema.EVENTS}` and
`{schema.FINDINGS}`.
"""
_POLARS = """import polars as pl
from rerun.chunk import RrdReader


def table(entity: str) -> pl.DataFrame:
    chunks = RrdReader("recordings/run.rrd").stream().filter(content=entity).to_chunks()
    return pl.concat([pl.from_arrow(chunk.to_record_batch()) for chunk in chunks])


touching = table("/state").join(table("/contacts"), on="sim_step")
rows = touching.select(
    "sim_step",
    pl.col("position_m").list.get(2).alias("height_m"),  # z of the first body
    pl.col("distance_m").list.min(),  # of all contact points
)
lowest = rows.sort("height_m").row(0, named=True)
print("step {sim_step}: height {height_m:.4f} m, distance {distance_m:.4f} m".format(**lowest))
"""
_READING = """## Reading it

How deep does the box sink into the floor? With polars, a table per entity:

```python
{polars}```

```text
{printed}```

This does not verify the digests; `drop analyze` does, and its `--table` writes the table above.
Many recordings at once are queried by Rerun's own [catalog](https://rerun.io/docs).
"""


@dataclass
class Entity:
    """The combined contents of all chunks of one entity."""

    timed: bool = False
    types: dict[str, str] = field(default_factory=dict)
    """Component or property -> type of its elements."""
    label: str = ""
    """Name of a curve, with its unit."""


def made() -> dict[str, str]:
    """Return the generated page."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "recordings/run.rrd")
        simulate(Scenario(), path, camera=Camera(capture_every=120, size_px=(32, 24)))
        table, run = analyze(path).table, _entities(path)
        (printed,) = run_python(_POLARS, Path(name))
    parts = [
        _HEAD,
        _STATE,
        _measured(run, schema.STATES),
        _CONTACTS,
        _measured(run, schema.CONTACTS),
        _rest(),
        "## Curves\n\nOne scalar per sample, with a colour and a name for the viewer.\n",
        _curves(run),
        "## For display\n",
        _drawn(run),
        _PROPERTIES,
        _LAYER,
        _table(table),
        _READING.format(polars=_POLARS, printed=printed),
    ]
    return {"recording.md": "\n".join(parts)}


def _rest() -> str:
    """Return a description of a recording's contents other than states and contacts."""
    sampled = _rows(["entity", "meaning"], ([f"`{k}`", v] for k, v in SAMPLED.items()))
    told = _rows(["entity", "a row when"], ([f"`{k}`", v] for k, v in HAPPENED.items()))
    return (
        "## Joints, constraints and calls\n\nThe poses of links follow from base and joints.\n\n"
        f"{sampled}\n## Events between the steps\n\nRows of JSON, in the component "
        f"`{schema.JSON}`, whenever something changes.\n\n{told}"
    )


def _entities(path: Path) -> dict[str, Entity]:
    entities: dict[str, Entity] = {}
    for chunk in rrd.chunks(path):
        entity = entities.setdefault(chunk.entity, Entity())
        entity.timed |= schema.STEP_TIMELINE in chunk.batch.schema.names
        for column in chunk.batch.schema:
            if pa.types.is_list(column.type):
                entity.types[column.name] = _element(column.type)
        if "SeriesLines:names" in chunk.batch.schema.names:
            entity.label = chunk.batch["SeriesLines:names"][0].as_py()[0]
    return entities


def _element(kind: pa.DataType) -> str:
    while pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        kind = kind.value_type
    return TYPES.get(str(kind), str(kind))


# -- tables ---------------------------------------------------------------------------------------


def _measured(run: Mapping[str, Entity], table: schema.Table) -> str:
    rows = []
    for component in table.components:
        columns = columns_of(component)
        dtype, names = (
            run[table.entity].types[component],
            ", ".join(f"`{name}`" for name in columns),
        )
        unit, description = _unit(component) or "", MEASURED[table.entity][component]
        rows.append([f"`{component}`", dtype, unit, names, description])
    return _rows(["component", "type", "unit", "columns", "meaning"], rows)


def _curves(entities: Mapping[str, Entity]) -> str:
    curves = {name: entity for name, entity in entities.items() if entity.label}
    rows = [
        [f"`{name}`", entity.types["Scalars:scalars"], _bracketed(entity.label), CURVES[name]]
        for name, entity in sorted(curves.items(), key=lambda pair: [*CURVES].index(pair[0]))
    ]
    return _rows(["entity", "type", "unit", "meaning"], rows)


def _drawn(entities: Mapping[str, Entity]) -> str:
    rows = []
    for name, entity in entities.items():
        if name.startswith("__") or name in (*schema.TABLES, *schema.TOLD) or entity.label:
            continue
        archetypes = dict.fromkeys(component.partition(":")[0] for component in entity.types)
        when = "over time" if entity.timed else "once"
        rows.append([f"`{name}`", ", ".join(archetypes), when, DRAWN[name]])
    return _rows(["entity", "Rerun's archetypes", "when", "meaning"], rows)


def _table(table: pl.DataFrame) -> str:
    rows = [
        [f"`{name}`", LAYER.get(name, ""), _unit(name) or "", TABLE_SAYS[name]]
        for name in table.columns
    ]
    return _rows(["column", "curve of the layer", "unit", "meaning"], rows)


def _unit(name: str) -> str | None:
    """Return the unit given by a name's suffix."""
    for suffix, unit in UNITS.items():
        if name.endswith(f"_{suffix}"):
            return unit
    return None


def _bracketed(label: str) -> str:
    (unit,) = re.findall(r"\[(.*)\]", label)
    return str(unit)


def _rows(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)

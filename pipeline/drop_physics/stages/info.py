"""The command `info`: describes a recording's origin, length, bodies and completeness."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

import numpy as np

from drop_physics.explain.times import StepTimes
from drop_physics.fields import counted
from drop_physics.installed import is_installed
from drop_physics.messages import Message, joined, shell_command
from drop_physics.printable import Printable
from drop_physics.recording import schema
from drop_physics.recording.about import engine_in_words
from drop_physics.recording.frames import frames, frames_of_cameras
from drop_physics.recording.inputs import Drop
from drop_physics.recording.layer_file import is_layer, layer_of
from drop_physics.recording.reader import Recording, listed, read, recording_id
from drop_physics.scenario import Scenario
from drop_physics.stages import verbs
from drop_physics.stages.found import Origin
from drop_physics.stages.program import command_of
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.sweeping.plan import replay_command
from drop_physics.trace.events import ENDED, Body, Dynamics
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET
from drop_physics.trace.history import Seen
from drop_physics.trace.readings import Reading
from drop_physics.trace.states import BODY_LABEL, FLOOR_LABEL, by_body

OPTIONS = ("steps", "duration_s", "seed", "python")
"""Recorded properties of a script that are options of `drop record`."""
REPLACED = "\ufffd"
"""Character recorded for each byte that is not UTF-8; see
`drop_physics.stages.program.encodable`."""


@dataclass(frozen=True)
class Info(Printable, reported_by="drop_physics.report.info"):
    """Kind and contents of a recording."""

    recording: Path
    """Path of the recording."""
    recording_id: str
    """Id of the recording; its analysis layer has the same id."""
    kind: Literal["drop", "script"]
    """`drop` or `script`."""
    what: str
    """Description of the recorded run: the dropped body, or the script and how it ended."""
    complete: bool
    """Whether the recording was finished; all data from which numbers and images are computed have
    then passed a checksum."""
    samples: int
    """Total number of states of the simulation."""
    duration_s: float
    """Simulated time from the first sample to the last [s]; for a script, of its longest
    simulation."""
    bodies: list[str]
    """The bodies, each with its mass."""
    contact_samples: int
    """Number of samples in which bodies touch."""
    frames: int
    """Number of camera frames in the recording."""
    bytes: int
    """Size of the file [bytes]."""
    engine: str
    """Name and version of the engine."""
    command: str | None
    """Command that repeats the recorded run; for a script, to be run in the script's folder, which
    is not recorded. None for a block of Python, and if a name or an argument is not UTF-8."""
    layer: Path | None
    """Path of the analysis layer; None if it is missing or belongs to another recording."""
    notes: list[str]
    """Sentences on missing parts of the recording, and from which step on."""
    readings: list[Reading]
    """Script lines that read values from the engine, in the order of their first use."""


def versions() -> str:
    """Return the versions of `drop`, of the engine, and of the recording schema."""
    drop, *engines = (
        f"{name} {metadata.version(package)}"
        for name, package in (
            ("drop", "drop-physics"),
            ("PyBullet", PYBULLET),
            ("MuJoCo", "mujoco"),
        )
        if package == "drop-physics" or is_installed(package)
    )
    return f"{drop} ({', '.join([*engines, f'recordings of schema {schema.SCHEMA_VERSION}'])})"


@takes_those_of(verbs.InfoArguments)
def info(asked: verbs.InfoArguments) -> Info:
    """Read and check a recording completely, and describe it.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, a layer, or was not written by drop.
    """
    held = read(Path(asked.recording))
    seen, path, ended = held.seen, held.path, held.ended or {}
    what, command, engine = _of_drop(held.drop) if held.drop else _of_script(held)
    samples = ended.get("samples", len(np.unique(seen.bases["step"])))
    return Info(
        recording=path,
        recording_id=held.recording_id,
        kind="drop" if held.drop else "script",
        what=what,
        complete=not held.partial,
        samples=int(samples),
        duration_s=_duration_s(seen),
        bodies=_bodies(seen),
        contact_samples=len(np.unique(seen.contacts["step"])),
        frames=len([*frames(held)])
        if held.drop
        else sum(map(len, frames_of_cameras(held).values())),
        bytes=path.stat().st_size,
        engine=engine,
        command=command,
        layer=_layer(path, held.recording_id),
        notes=[*listed(ended.get("notes")), *([held.lacks] if held.lacks else [])],
        readings=seen.readings,
    )


def _of_drop(drop: Drop) -> tuple[str, str | None, str]:
    """Describe a drop: its body, the command that repeats it, and its engine."""
    scenario, standard = drop.scenario, Scenario()
    given = {
        name: getattr(scenario, name)
        for name in Scenario.options()
        if getattr(scenario, name) != getattr(standard, name)
    }
    again = replay_command(given, out="again.rrd")
    body = Path(scenario.body).name
    return (
        Message("{body} dropped from {height:g} m", body=body, height=scenario.height_m),
        again if drop.camera is None else again.replace(" --no-camera", "", 1),
        engine_in_words(scenario, drop.engine),
    )


def _of_script(held: Recording) -> tuple[str, str | None, str]:
    """Describe a recorded script: its name, how it ended, how to repeat it, and the engine."""
    origin, ended = held.origin, held.ended
    script = str(origin["script"])
    program = [*script.split(" ", 1)] if script.startswith("-m ") else [script]
    words = [*program, *map(str, listed(origin.get("arguments")))]
    what = script if script == schema.BLOCK else shell_command(*words)
    command = repeated("record", origin)
    engine: str = engine_of(held)
    if ended is not None and "made_with_version" in ended:  # not where its first bytes were lost
        engine = Message(
            "{engine} in Python {version}", engine=engine, version=ended["made_with_version"]
        )
    how = ENDED.get(str((ended or {}).get("ended")), Message("never finished"))
    return Message("{script}, {ended}", script=what, ended=how), command, engine


def engine_of(held: Recording) -> str:
    """Return name and version of a script's engine, even if no step was made."""
    ended = held.ended or {}
    mujoco, bullet = (ended.get(f"made_with_{name}") for name in ("mujoco", "pybullet"))
    if mujoco and not held.seen.settings:
        return f"MuJoCo {mujoco}"
    if held.seen.engine != PYBULLET:
        return held.seen.engine
    if not held.partial and "made_with_pybullet_api" not in ended:
        return Message("none that was imported")
    return f"{PYBULLET} {bullet or ''}".rstrip()


def repeated(
    verb: str,
    origin: Origin,
    script: Path | None = None,
    **more: str | None,
) -> str | None:
    """Return the command line of drop's command `verb` for a recorded script, with its options.

    None for a block of Python, and if a name or an argument is not UTF-8. The script is given by
    its path, if that is known.
    """
    name, arguments = str(origin["script"]), [*map(str, listed(origin.get("arguments")))]
    if (
        name == schema.BLOCK
        or origin.get("kind") == schema.IMPORTED
        or any(REPLACED in word for word in (name, *arguments))
    ):
        return None
    options = {name.removesuffix("_s"): origin.get(name) for name in OPTIONS}
    return command_of(verb, name if script is None else script, arguments, **options, **more)


def _duration_s(seen: Seen) -> float:
    """Return the time of the last sample of the longest simulation [s]."""
    last = {client: samples - 1 for client, samples in seen.samples.items()}
    if not last:
        ends = ((number, int(rows["step"][-1])) for number, rows in by_body(seen.bases).items())
        found = [*ends, *((number, int(joint.steps[-1])) for number, joint in seen.joints.items())]
        for body, step in found:
            client = seen.bodies[body].client
            last[client] = max(step, last.get(client, 0))
    clients = {settings.client for settings in seen.settings}
    return max(
        (StepTimes(seen, client).of(step) for client, step in last.items() if client in clients),
        default=0.0,
    )


def _bodies(seen: Seen) -> list[str]:
    """Describe each body's mass and joints, except for the floor of a drop."""
    last = {dynamics.body.number: dynamics for dynamics in seen.dynamics}
    # Where a call adds a body is reported as a move, too.
    came = {(one.body.number, one.at.step, one.at.call) for one in seen.appearances if one.came}
    moved = {
        put.body.number
        for put in seen.puts
        if (put.body.number, put.at.step, put.at.call) not in came
    }
    return [
        _body(body, last.get(body.number), moved=body.number in moved)
        for body in seen.bodies.values()
        if body.label != FLOOR_LABEL
    ]


def _body(body: Body, dynamics: Dynamics | None, *, moved: bool) -> Message:
    if body.soft:
        return Message("{label}, soft", label=body.label)
    mass_kg = float(dynamics.reported["mass_kg"].sum()) if dynamics else 0.0
    label = body.name if body.label == BODY_LABEL else body.label
    text = Message("{label}, held still", label=label)
    if mass_kg or moved or body.moving:
        text = Message("{label}, {mass:.4g} kg", label=label, mass=mass_kg)
    return joined(", ", [text, counted(len(body.joints), "joint")]) if body.joints else text


def _layer(path: Path, belongs_to: str) -> Path | None:
    layer = layer_of(path)
    return layer if is_layer(layer) and recording_id(layer) == belongs_to else None

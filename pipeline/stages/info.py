"""Describe a recording: what made it, its length, its bodies, and whether it is complete."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import polars as pl

from pipeline.analysis.general.jsonable import jsonable
from pipeline.analysis.script.times import Times
from pipeline.fields import counted
from pipeline.messages import Message, joined, shell_command
from pipeline.recording.about import engine_in_words
from pipeline.recording.contents import is_script
from pipeline.recording.layer import is_layer, layer_of
from pipeline.recording.reader import Recording, frames, read, recording_id
from pipeline.recording.script_reader import ScriptRecording, read_script
from pipeline.recording.script_scene import frames_of_cameras
from pipeline.scenario import Scenario
from pipeline.seen import Body, Seen
from pipeline.shown import Shown
from pipeline.stages.record import DURATION_S
from pipeline.stages.record_block import BLOCK
from pipeline.sweeping.plan import replay_command

REPLACED = "\ufffd"
"""Recorded for each byte that is not UTF-8; see `pipeline.stages.record.encodable`."""


@dataclass(frozen=True)
class Info(Shown, lines_of="pipeline.console.show_info:info_lines"):
    """What a recording is and holds."""

    recording: Path
    """The file."""
    recording_id: str
    """Its id, which its layer shares."""
    kind: Literal["drop", "script"]
    """Whether a drop or a script was recorded."""
    what: str
    """The body that was dropped, or the script and how it ended."""
    complete: bool
    """Whether it was finished; then everything that numbers and images are computed from has passed
    its checksum."""
    samples: int
    """How many states of the simulation it holds, in all."""
    duration_s: float
    """Simulated time from its first sample to its last [s]; for a script, of its longest
    simulation."""
    bodies: list[str]
    """The bodies, each with its mass."""
    contact_samples: int
    """Samples in which something touches."""
    frames: int
    """How many camera frames it holds."""
    bytes: int
    """The file's size."""
    engine: str
    """The engine that made it."""
    command: str | None
    """The command that repeats its physics; for a script in its folder, which is not recorded. None
    for a block of Python, and where a name or an argument is not UTF-8."""
    layer: Path | None
    """The analysis beside it; None if there is none, or it is of another recording."""

    def as_json(self) -> dict[str, object]:
        """Return the contract's JSON object."""
        return dict(jsonable(vars(self)))


def info(recording: Path | str) -> Info:
    """Describe a recording, which is read and checked completely.

    Raises
    ------
    RecordingError
        If it is missing, damaged, a layer, or not one of ours.
    """
    path = Path(recording)
    return _of_script(read_script(path)) if is_script(path) else _of_drop(read(path))


def _of_drop(recording: Recording) -> Info:
    scenario, path = recording.scenario, recording.path
    samples = int(recording.states["step"].max()) + 1  # type: ignore[arg-type]
    standard = Scenario()
    given = {
        name: getattr(scenario, name)
        for name in Scenario.options()
        if getattr(scenario, name) != getattr(standard, name)
    }
    again = replay_command(given, out="again.rrd")
    body = Path(scenario.body).name
    return Info(
        recording=path,
        recording_id=recording.recording_id,
        kind="drop",
        what=Message("{body} dropped from {height:g} m", body=body, height=scenario.height_m),
        complete=not recording.partial,
        samples=samples,
        duration_s=(samples - 1) * scenario.timestep_s,
        bodies=[_body(body, recording.engine.mass_kg, recording.engine.joints)],
        contact_samples=recording.contacts["step"].n_unique(),
        frames=len(list(frames(path))),
        bytes=path.stat().st_size,
        engine=engine_in_words(scenario, recording.engine),
        command=again if recording.camera is None else again.replace(" --no-camera", "", 1),
        layer=_layer(path, recording.recording_id),
    )


def _of_script(recording: ScriptRecording) -> Info:
    seen, path, origin = recording.seen, recording.path, recording.origin
    ended = recording.ended or {}
    script, arguments = str(origin["script"]), _texts(origin.get("arguments"))
    limits = {name: origin.get(name) for name in ("steps", "duration_s", "seed")}
    options = [
        word
        for name, value in limits.items()
        if value is not None and (name, value) != ("duration_s", DURATION_S)
        for word in (f"--{name.removesuffix('_s')}", _digits(value))
    ]
    program = [*_program(script), *arguments]
    what = script if script == BLOCK else shell_command(*program)
    command = None
    if script != BLOCK and not any(REPLACED in word for word in program):
        options_end = ["--"] if program[0].startswith("-") and program[0] != "-m" else []
        command = shell_command("drop", "record", *options, *options_end, *program)
    samples = ended.get("samples", seen.states["step"].n_unique())
    return Info(
        recording=path,
        recording_id=recording.recording_id,
        kind="script",
        what=f"{what}, {ended.get('ended', 'never finished')}",
        complete=not recording.partial,
        samples=int(samples),
        duration_s=_duration_s(seen),
        bodies=[
            Message("{label}, soft", label=body.label) if body.soft else _scripts_body(body, seen)
            for body in seen.bodies.values()
        ],
        contact_samples=seen.contacts["step"].n_unique(),
        frames=sum(map(len, frames_of_cameras(path).values())),
        bytes=path.stat().st_size,
        engine=Message("PyBullet in Python {version}", version=ended["made_with_version"])
        if ended
        else "PyBullet",
        command=command,
        layer=_layer(path, recording.recording_id),
    )


def _digits(value: float) -> str:
    """Return a number so that the same is read back; 2, not 2.0."""
    short = f"{value:.9g}"
    return short if isinstance(value, float) and float(short) == value else str(value)


def _program(script: str) -> list[str]:
    """Return the words that name a script, or a module as `-m MODULE`."""
    return script.split(" ", 1) if script.startswith("-m ") else [script]


def _texts(value: object) -> list[str]:
    """Return a property that is a list of texts; Rerun reads a list of one as its element."""
    return [] if value is None else [*map(str, value if isinstance(value, list) else [value])]


def _duration_s(seen: Seen) -> float:
    """Return the time of the last sample [s], of the longest simulation."""
    last = {client: samples - 1 for client, samples in seen.samples.items()}
    if not last:
        steps = seen.states.group_by("body").agg(pl.col("step").max()).iter_rows()
        for body, step in steps:
            client = seen.bodies[body].client
            last[client] = max(step, last.get(client, 0))
    clients = {settings.client for settings in seen.settings}
    return max(
        (Times(seen, client).of(step) for client, step in last.items() if client in clients),
        default=0.0,
    )


def _scripts_body(body: Body, seen: Seen) -> Message:
    record = seen.by_body[body.number]
    mass_kg = float(record.dynamics[-1].reported["mass_kg"].sum()) if record.dynamics else 0.0
    moves = record.moves or (body.number, min(body.moving, default=-1)) in seen.parts
    if mass_kg or moves:
        return _body(body.label, mass_kg, len(body.joints))
    still = Message("{label}, held still", label=body.label)
    return joined(", ", [still, counted(len(body.joints), "joint")]) if body.joints else still


def _body(label: str, mass_kg: float, joints: int) -> Message:
    body = Message("{label}, {mass:.4g} kg", label=label, mass=mass_kg)
    return joined(", ", [body, counted(joints, "joint")]) if joints else body


def _layer(path: Path, belongs_to: str) -> Path | None:
    layer = layer_of(path)
    return layer if is_layer(layer) and recording_id(layer) == belongs_to else None

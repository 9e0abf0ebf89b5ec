"""Say what a recording is: of what, how long, of which bodies, and whether it is whole."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import polars as pl

from pipeline.analysis.general.jsonable import jsonable
from pipeline.analysis.script.times import Times
from pipeline.fields import counted
from pipeline.messages import shell_command
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
    """What a recording is."""

    recording: Path
    """The file."""
    recording_id: str
    """Its id, which its layer shares."""
    kind: Literal["drop", "script"]
    """Of what it is."""
    what: str
    """The body that was dropped, or the script and how it ended."""
    complete: bool
    """Whether it was finished; then all that it holds has passed its checksums."""
    samples: int
    """How many states of the simulation it holds, together."""
    duration_s: float
    """Simulated time from its first sample to its last [s]; of a script, of its longest
    simulation."""
    bodies: list[str]
    """The bodies that can be told apart, each with its mass."""
    contact_samples: int
    """Steps after which something touches."""
    frames: int
    """How many camera frames it holds."""
    bytes: int
    """The file's size."""
    engine: str
    """What made it."""
    command: str | None
    """What makes its physics again; None of a block of Python, and where a name or an argument was
    not UTF-8."""
    layer: Path | None
    """The analysis beside it; None where there is none, or it is of another recording."""

    def as_json(self) -> dict[str, object]:
        """Return the contract's JSON object."""
        return dict(jsonable(vars(self)))


def info(recording: Path | str) -> Info:
    """Say what a recording is; all of it is read, and checked.

    Raises
    ------
    RecordingError
        If it is missing, damaged, a layer, or not one of ours.
    """
    path = Path(recording)
    return _of_script(read_script(path)) if is_script(path) else _of_drop(read(path))


def _of_drop(found: Recording) -> Info:
    scenario, path = found.scenario, found.path
    samples = int(found.states["step"].max()) + 1  # type: ignore[arg-type]
    standard = Scenario()
    given = {
        name: getattr(scenario, name)
        for name in Scenario.options()
        if getattr(scenario, name) != getattr(standard, name)
    }
    again = replay_command(given, out="again.rrd")
    joints = f", {counted(found.engine.joints, 'joint')}" if found.engine.joints else ""
    return Info(
        recording=path,
        recording_id=found.recording_id,
        kind="drop",
        what=f"{Path(scenario.body).name} dropped from {scenario.height_m:g} m",
        complete=not found.partial,
        samples=samples,
        duration_s=(samples - 1) * scenario.timestep_s,
        bodies=[f"{Path(scenario.body).name}, {found.engine.mass_kg:.4g} kg{joints}"],
        contact_samples=found.contacts["step"].n_unique(),
        frames=len(list(frames(path))),
        bytes=path.stat().st_size,
        engine=engine_in_words(scenario, found.engine),
        command=again if found.camera is None else again.replace(" --no-camera", "", 1),
        layer=_layer(path, found.recording_id),
    )


def _of_script(found: ScriptRecording) -> Info:
    seen, path, origin, ended = found.seen, found.path, found.origin, found.ended or {}
    script, arguments = str(origin["script"]), _texts(origin.get("arguments"))
    limits = {name: origin.get(name) for name in ("steps", "duration_s", "seed")}
    options = [
        word
        for name, value in limits.items()
        if value is not None and (name, value) != ("duration_s", DURATION_S)
        for word in (f"--{name.removesuffix('_s')}", _digits(value))
    ]
    program = [*_program(script), *arguments]
    told = shell_command(*program)
    again = None
    if script != BLOCK and not any(REPLACED in word for word in program):
        options_end = ["--"] if program[0].startswith("-") and program[0] != "-m" else []
        again = shell_command("drop", "record", *options, *options_end, *program)
    samples = ended.get("samples", seen.states["step"].n_unique())
    return Info(
        recording=path,
        recording_id=found.recording_id,
        kind="script",
        what=f"{script if script == BLOCK else told}, {ended.get('ended', 'never finished')}",
        complete=not found.partial,
        samples=int(samples),
        duration_s=_duration_s(seen),
        bodies=[_body(body, seen) for body in seen.bodies.values()],
        contact_samples=seen.contacts["step"].n_unique(),
        frames=sum(map(len, frames_of_cameras(path).values())),
        bytes=path.stat().st_size,
        engine=f"PyBullet in Python {ended['made_with_version']}" if ended else "PyBullet",
        command=again,
        layer=_layer(path, found.recording_id),
    )


def _digits(value: float) -> str:
    """Return a number so that the same is read back; 2, not 2.0."""
    short = f"{value:.9g}"
    return short if isinstance(value, float) and float(short) == value else str(value)


def _program(script: str) -> list[str]:
    """Return the words that name a script, or a module: `-m MODULE`."""
    return script.split(" ", 1) if script.startswith("-m ") else [script]


def _texts(value: object) -> list[str]:
    """Return a property that is a list of texts; Rerun keeps one of one as its element."""
    return [] if value is None else [*map(str, value if isinstance(value, list) else [value])]


def _duration_s(seen: Seen) -> float:
    """Return the time of the last sample [s], of the simulation that goes on longest."""
    last = seen.states.group_by("body").agg(pl.col("step").max()).iter_rows()
    return max((Times(seen, seen.bodies[body].client).of(step) for body, step in last), default=0.0)


def _body(body: Body, seen: Seen) -> str:
    told = seen.by_body[body.number].dynamics
    mass_kg = float(told[-1].reported["mass_kg"].sum()) if told else 0.0
    joints = f", {counted(len(body.joints), 'joint')}" if body.joints else ""
    return f"{body.label}, {f'{mass_kg:.4g} kg' if mass_kg else 'held still'}{joints}"


def _layer(path: Path, belongs_to: str) -> Path | None:
    layer = layer_of(path)
    return layer if is_layer(layer) and recording_id(layer) == belongs_to else None

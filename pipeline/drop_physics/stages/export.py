"""The command `export`: writes states, joints and contacts as tables or as MCAP."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.errors import check_suffix
from drop_physics.explain.times import StepTimes
from drop_physics.files.mcap_file import Write, stamp, written_mcap
from drop_physics.files.outputs import check_apart, check_target
from drop_physics.physics.tree import places
from drop_physics.printable import Printable
from drop_physics.recording.reader import Recording, read
from drop_physics.stages import verbs
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.trace.events import Body, Joint
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.states import BASE, CONTACT, Joints, poses_of

if TYPE_CHECKING:
    import polars as pl

TABLES = ("states", "joints", "contacts")
SUFFIXES = (".mcap", ".csv", ".parquet")
MEASURED = ("position", "velocity", "effort")
TimesOf = Callable[[int, Int64], Float64]
"""Function that returns the times [s] of a body's steps."""


@dataclass(frozen=True)
class Export(Printable, reported_by="drop_physics.report.export"):
    """Result of an export: the files written."""

    recording: Path
    """The exported recording."""
    files: dict[str, int]
    """Paths of the files, with their numbers of rows or messages."""


@takes_those_of(verbs.ExportArguments)
def export(asked: verbs.ExportArguments) -> Export:
    """Write a recording's states, joints and contact points for other tools.

    Raises
    ------
    RecordingError
        If the recording is missing, damaged, or was not written by drop.
    ScenarioError
        If a file's suffix is not supported.
    OutputError
        If a file cannot be written.
    DropError
        For `.mcap`, if the package mcap is not installed.
    """
    path = Path(asked.recording)
    target = path.with_suffix(".csv") if asked.out is None else Path(asked.out)
    check_suffix("--out", target, SUFFIXES)
    is_mcap = target.suffix == ".mcap"
    files = [target]
    if not is_mcap:
        files = [target.with_name(f"{target.stem}.{name}{target.suffix}") for name in TABLES]
    check_apart(files, inputs=[path])
    for file in files:
        check_target(file, force=asked.force)
    if is_mcap:
        with written_mcap(target, force=asked.force) as write:
            return Export(path, {str(target): _messages(read(path), write)})
    from drop_physics.files.table import write_table  # with Polars, which needs much memory

    read_back = read(path)
    tables = _named(read_back, read_back.states), _joints(read_back), _contacts(read_back)
    for file, table in zip(files, tables, strict=True):
        write_table(file, table, force=asked.force)
    return Export(path, dict(zip(map(str, files), map(len, tables), strict=True)))


def _times_of(recording: Recording) -> TimesOf:
    seen = recording.seen
    if recording.drop is not None:
        timestep_s = recording.scenario.timestep_s
        return lambda _, steps: np.multiply(steps, timestep_s, dtype=np.float64)
    clients = {body.client for body in seen.bodies.values()}
    times = {client: StepTimes(seen, client) for client in clients}
    return lambda body, steps: times[seen.bodies[body].client].of_all(steps)


# -- tables ---------------------------------------------------------------------------------------


def _named(recording: Recording, table: pl.DataFrame, body: str = "body") -> pl.DataFrame:
    """Return a table with each row's time, and with labels and links of bodies."""
    import polars as pl

    times, bodies = _times_of(recording), recording.seen.bodies
    steps, numbers = table["step"].to_numpy(), table[body].to_numpy()
    times_s = np.zeros(len(table))
    for number in np.unique(numbers):
        rows = numbers == number
        times_s[rows] = times(int(number), steps[rows])
    named = table.insert_column(1, pl.Series("time_s", times_s))
    for side in ("", "_a", "_b"):
        if f"body{side}" in table.columns:
            labels = {number: each.label for number, each in bodies.items()}
            links = {
                (number, link): name
                for number, each in bodies.items()
                for link, name in enumerate(each.links, -1)
            }
            parts = zip(named[f"body{side}"], named[f"link{side}"], strict=True)
            names = [links.get(part, "") for part in parts]
            label = pl.col(f"body{side}").replace_strict(labels, return_dtype=pl.String)
            named = named.with_columns(
                label.alias(f"label{side}"), pl.Series(f"link_name{side}", names, pl.String)
            )
    return named


def _contacts(recording: Recording) -> pl.DataFrame:
    return _named(recording, recording.contacts, "body_a")


def _joints(recording: Recording) -> pl.DataFrame:
    """Return a table with a row per step and joint position; spherical joints have four rows.

    Positions are in [rad] or [m], efforts in [N m] or [N].
    """
    import polars as pl

    schema = pl.Schema(
        {
            "step": pl.Int64,
            "time_s": pl.Float64,
            "body": pl.Int64,
            "label": pl.String,
            "joint": pl.Int64,
            "name": pl.String,
            "coordinate": pl.Int64,
            **dict.fromkeys(MEASURED, pl.Float64),
        }
    )
    times, tables = _times_of(recording), [pl.DataFrame(schema=schema)]
    for body, joints in _driven(recording.seen.bodies, recording.seen.joints):
        times_s = times(body.number, joints.steps)
        for joint, coordinates in _coordinates(body, joints):
            for number, measured in enumerate(coordinates):
                table = pl.DataFrame({"step": joints.steps, "time_s": times_s}).with_columns(
                    pl.lit(body.number).alias("body"),
                    pl.lit(body.label).alias("label"),
                    pl.lit(joint.link).alias("joint"),
                    pl.lit(joint.name).alias("name"),
                    pl.lit(number).alias("coordinate"),
                    *(
                        pl.lit(None).alias(name) if values is None else pl.Series(name, values)
                        for name, values in zip(MEASURED, measured, strict=True)
                    ),
                )
                tables.append(table.cast(schema))
    return pl.concat(tables)


def _driven(
    bodies: Mapping[int, Body], joints: Mapping[int, Joints]
) -> Iterator[tuple[Body, Joints]]:
    for number, its in sorted(joints.items()):
        if number in bodies:
            yield bodies[number], its


Coordinate = tuple[Float64 | None, Float64 | None, Float64 | None]
"""Positions, velocities and efforts of a coordinate in all samples; None where missing."""


def _coordinates(body: Body, joints: Joints) -> Iterator[tuple[Joint, list[Coordinate]]]:
    """Yield the positions of each movable joint, one item per coordinate."""
    numbers = joints.position, joints.velocity, joints.effort
    widths = zip(*(joint.widths for joint in body.joints), strict=True)
    for joint, *its in zip(body.joints, *map(places, widths), strict=True):
        columns = [values[:, at].T for values, at in zip(numbers, its, strict=True)]
        if any(map(len, columns)):
            yield joint, [*itertools.zip_longest(*columns)]


# -- MCAP -----------------------------------------------------------------------------------------


def _messages(recording: Recording, write: Write) -> int:
    """Write poses, joints and contact points in time order; return the number of messages."""
    times, seen, count = _times_of(recording), recording.seen, 0
    for piece in seen.pieces():
        found = [
            *_transforms(piece, seen, times),
            *_joint_states(piece, seen, times),
            *_touching(piece, seen, times),
        ]
        for time_s, topic, content in sorted(found, key=lambda each: each[0]):
            write(topic, time_s, content)
        count += len(found)
    return count


Timed = tuple[float, str, Any]
"""A message: its time [s], topic and content."""


def _transforms(piece: Piece, seen: Seen, times: TimesOf) -> Iterator[Timed]:
    """Yield the poses of all links at each time: centres of mass and principal axes of inertia."""
    at: dict[float, list[Any]] = defaultdict(list)
    for (number, link), rows in seen.parts_of(piece).items():
        body = seen.bodies[number]
        child = body.label if link == BASE else f"{body.label}/{body.links[link + 1]}"
        poses = poses_of(rows).tolist()
        for time_s, pose in zip(times(number, rows["step"]).tolist(), poses, strict=True):
            at[time_s].append(
                {
                    "timestamp": stamp(time_s),
                    "parent_frame_id": "world",
                    "child_frame_id": child,
                    "translation": dict(zip("xyz", pose[:3], strict=True)),
                    "rotation": dict(zip("xyzw", pose[3:], strict=True)),
                }
            )
    for time_s, transforms in at.items():
        yield time_s, "/tf", {"transforms": transforms}


def _joint_states(piece: Piece, seen: Seen, times: TimesOf) -> Iterator[Timed]:
    """Yield the states of single-coordinate joints at each time, per robot if there are several."""
    at: dict[float, list[Any]] = defaultdict(list)
    several = len(seen.joints) > 1
    for body, joints in _driven(seen.bodies, piece.joints):
        prefix = f"{body.label}/" if several else ""
        times_s = times(body.number, joints.steps).tolist()
        for joint, coordinates in _coordinates(body, joints):
            if len(coordinates) != 1:
                continue
            columns = {
                name: values.tolist()
                for name, values in zip(MEASURED, coordinates[0], strict=True)
                if values is not None
            }
            for row, time_s in enumerate(times_s):
                measured = {name: values[row] for name, values in columns.items()}
                at[time_s].append({"name": f"{prefix}{joint.name}", **measured})
    for time_s, states in at.items():
        yield time_s, "/joint_states", {"timestamp": stamp(time_s), "joints": states}


def _touching(piece: Piece, seen: Seen, times: TimesOf) -> Iterator[Timed]:
    at: dict[float, list[Any]] = defaultdict(list)
    names = [name for name in CONTACT.names or () if name != "step"]
    for row in piece.contacts:
        numbers = int(row["body_a"]), int(row["body_b"])
        time_s = float(times(numbers[0], row["step"][None])[0])
        values = {name: row[name].tolist() for name in names}
        labels = {
            "label_a": seen.bodies[numbers[0]].label,
            "label_b": seen.bodies[numbers[1]].label,
        }
        at[time_s].append(values | labels)
    for time_s, points in at.items():
        yield time_s, "/contacts", {"timestamp": stamp(time_s), "contacts": points}

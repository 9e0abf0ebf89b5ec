"""Converts a run's events to the chunks of a recording, in the right order.

Numbers are stored as float64, in the entities `state`, `joints`, `contacts`, `calls` and others
(`schema`). The parts for display (`drawing`) are thinned to as many as a viewer can show.
"""

from __future__ import annotations

import hashlib
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.recording import json_rows, pictures, schema, writer
from drop_physics.recording.digest import (
    Digests,
    FrameDigest,
    ToldDigest,
    closing_digest,
    inputs_digest,
)
from drop_physics.recording.drawing import Drawing
from drop_physics.recording.falling import Falling
from drop_physics.recording.gathering import Gathering
from drop_physics.recording.joints import Commands, joint_names
from drop_physics.recording.layout import Look, eye_around, series_of
from drop_physics.recording.step_frames import deflated, packed
from drop_physics.recording.writer import Chunk, Times
from drop_physics.trace.events import (
    Appearance,
    Body,
    Calls,
    ContactRows,
    Controls,
    Ending,
    Event,
    Image,
    Impulses,
    Raised,
    Samples,
    Site,
    Surface,
    widths_of,
)
from drop_physics.trace.frames import Frames, ModelPart
from drop_physics.trace.history import rows_of_bases
from drop_physics.trace.states import Rows

ROWS_TOGETHER = 1024
"""Number of rows that are buffered before they are written as a chunk."""
MANY, SHORT, SOON_S = 64, 64, 1.0
"""After `MANY` batches of fewer than `SHORT` steps, further short batches are collected for
`SOON_S` [s] and written together, since a chunk takes 1 kB and 1 ms, however small it is."""
LONGEST, MOST_NOTES = 1000, 10
"""Largest number of characters of a text, and of notes, in a property."""

Properties = Mapping[str, Mapping[str, Any]]


class Recorder:
    """A recording in progress: converts events to chunks.

    Parameters
    ----------
    inputs
        Properties that describe the run (see `schema.INPUT_PROPERTIES`).
    compared
        Whether the run will be compared with another: a digest of each state is then kept.
    of_drop
        Whether a drop is recorded, which has further curves and is shown in slow motion.
    drawn
        Whether a script's recording includes entities that are only for display.
    """

    def __init__(
        self,
        inputs: Properties,
        *,
        compared: bool = False,
        of_drop: bool = False,
        drawn: bool = True,
    ) -> None:
        self.inputs, self.compared, self.drawn = inputs, compared, drawn
        self.samples = self.frames = 0
        self.bodies: dict[int, Body] = {}
        """All bodies that ever existed, by id."""
        self.cameras: dict[str, int] = {}
        self._stepped = False
        self._entities: set[str] = set()
        self._meshes: set[str] = set()
        self.drawing = Drawing(self.bodies, of_drop=of_drop)
        self._ends: dict[int, int] = {}
        """Last sampled step of each simulation."""
        self.sites: dict[int, Site] = {}
        self._made = Digests()
        self._pictures: dict[int, FrameDigest] = {}
        self._told_rows = ToldDigest()
        self._commands = Commands()
        self._rows = Gathering(writer.texts_chunk, most=ROWS_TOGETHER)
        self._calls = Gathering(_calls_chunk, most=ROWS_TOGETHER)
        self._tables = {each: Gathering(_table_chunk, most=ROWS_TOGETHER) for each in schema.TABLES}
        self._series = Gathering(_series_chunk, most=ROWS_TOGETHER)
        self._frames = Gathering(writer.steps_chunk, most=ROWS_TOGETHER)
        self._slots: dict[int, dict[tuple[int, int], int]] = {}
        """Entity slots of constraints in each simulation, by constraint id and number of force
        components."""
        self._short = 0
        self._held_since_s: float | None = None
        """Time at which the first buffered batch was added [s]; None if no batch is buffered."""
        self._digests: dict[int, list[tuple[int, bytes]]] = {}

    def chunks(
        self,
        events: Iterable[Event],
        ending: Callable[[], Ending],
        about: Callable[[Ending], str],
        beside: Falling | None = None,
    ) -> Iterator[Chunk]:
        """Yield all chunks of the recording.

        Parameters
        ----------
        events
            The events of the run, in order.
        ending
            A function that is called after the last event, and returns how the run ended.
        about
            A function that is called with the ending, and returns a description in Markdown.
        beside
            The further views of a drop; None for a script.
        """
        for chunk in self._chunks(events, ending, about, beside):
            entity = chunk.entity_path.removeprefix("/")
            if self.drawn or not _is_for_looking(entity):
                self._entities.add(entity)
                yield chunk

    def look(self) -> Look:
        """Return the properties of the recording on which its layout depends."""
        return Look(
            eye_around(self.drawing.low_m, self.drawing.high_m),
            frozenset(self._entities),
            series=series_of(self.bodies.values()),
            cameras={f"camera/{number}/image": name for name, number in self.cameras.items()},
            timeline=schema.TIME_TIMELINE if self._stepped else schema.CALL_TIMELINE,
        )

    def _chunks(
        self,
        events: Iterable[Event],
        ending: Callable[[], Ending],
        about: Callable[[Ending], str],
        beside: Falling | None,
    ) -> Iterator[Chunk]:
        for name, values in self.inputs.items():
            yield writer.property_chunk(name, values)
        if self.drawn:
            yield from self.drawing.scene()
        yield from beside.begin() if beside else ()
        for event in events:
            yield from self._on(event)
            if beside is not None and isinstance(event, Samples):
                yield from beside.chunks(event)
                for step, png, shown in beside.frames(event):
                    self._on_frame(0, step, png)
                    yield from shown
        yield from self._flush()
        yield from self._commands.end()
        yield from self.drawing.flush()
        ended = ending()
        ended.notes += self.drawing.notes()
        yield writer.document_chunk(schema.ABOUT, about(ended))
        yield writer.property_chunk(schema.RECORDING_PROPERTY, self._closing(ended))

    def _closing(self, ending: Ending) -> dict[str, Any]:
        origin = self.inputs.get(schema.ORIGIN_PROPERTY, {})
        closing = {
            "schema_version": schema.SCHEMA_VERSION,
            "samples": self.samples,
            "samples_of_clients": [
                self._ends.get(client, -1) + 1 for client in range(max(self._ends, default=-1) + 1)
            ]
            or None,
            "bodies": len(self.bodies),
            "frames": self.frames,
            "ended": ending.how,
            "error": ending.error[:LONGEST] or None,
            "error_site": ending.site[:LONGEST] or None,
            "script_sha256": None if origin.get("script_sha256") else ending.main_sha256,
            "notes": [note[:LONGEST] for note in ending.notes[:MOST_NOTES]] or None,
            **{
                f"{entity}_sha256": table.hexdigest() for entity, table in self._made.tables.items()
            },
            "frames_sha256": [each.hexdigest() for _, each in sorted(self._pictures.items())]
            or None,
            "series_sha256": self._made.series,
            "calls_sha256": self._made.calls,
            "impulses_sha256": self._made.impulses,
            "models_sha256": self._made.models,
            "steps_sha256": self._made.steps,
            "told_sha256": self._told_rows.hexdigest(),
            "inputs_sha256": inputs_digest(self.inputs),
            "interpreter": ending.interpreter,
            **{f"made_with_{name}": value for name, value in ending.made_with.items()},
        }
        return closing | {"closing_sha256": closing_digest(closing)}

    def _on(self, event: Event) -> Iterator[Chunk]:
        match event:
            case Samples():
                yield from self._on_samples(event)
            case Calls():
                yield from self._on_calls(event)
            case Image():
                yield from self._on_image(event)
            case Impulses():
                self._made.add_impulses(event)
                yield from self._rows.flush()  # their causes
                yield writer.impulses_chunk(event)
            case Controls():
                yield from self._on_controls(event)
            case ModelPart():
                part = deflated(event)
                self._made.add_model(part.number, part.at, part.data)
                yield writer.model_chunk(part)
            case Frames():
                self._on_frames(event)
            case ContactRows():
                self._add_contacts(event.client, event.contacts, event.steps, event.times_s)
                yield from self._tables[schema.CONTACTS.entity].flush()
                if self.drawn:
                    yield from self.drawing.on_touching(event)
            case _:
                yield from self._tell(event)

    def _tell(self, event: Event) -> Iterator[Chunk]:
        """Buffer a row of JSON, and yield rows once there are enough."""
        if isinstance(event, Surface) and not self.drawn:
            return
        if isinstance(event, Site):
            self.sites[event.number] = event
        if isinstance(event, Appearance):
            if event.body.number not in self.bodies:
                yield from self._names_of_joints(event.body)
            self.bodies[event.body.number] = event.body
            yield from self._commands.on_appearance(event)
        if isinstance(event, Raised):
            self._commands.on_raised(event)
        entity, at, values = json_rows.row_of(event)
        if isinstance(event, Surface):
            json_rows.keep_once(values, self._meshes)
        text = json_rows.packed(values)
        self._told_rows.update(entity, at.step, at.call, text)
        yield from self._rows.add(entity, writer.times_of(at), text)
        if self.drawn:
            yield from self.drawing.on(event)

    def _names_of_joints(self, body: Body) -> Iterator[Chunk]:
        if any(any(joint.widths) for joint in body.joints):
            for name in schema.OF_JOINTS:
                if names := joint_names(body, name):
                    yield writer.series_chunk(f"{schema.JOINTS}/{body.label}/{name}", names)

    # -- samples ----------------------------------------------------------------------------------

    def _on_samples(self, seen: Samples) -> Iterator[Chunk]:
        if self.compared:
            self.take_in(seen)
        if not len(seen.steps):
            return
        self.samples += len(seen.steps)
        self._ends[seen.client] = int(seen.steps[-1])
        self._stepped |= bool(seen.steps[-1] > 0)
        at = Times(seen.steps, seen.times_s)
        self._add_contacts(seen.client, seen.contacts, seen.steps, seen.times_s)
        for number, joints in seen.joints.items():
            for name in schema.OF_JOINTS:
                entity = f"{schema.JOINTS}/{self.bodies[number].label}/{name}"
                self._add_series(entity, at, getattr(joints, name))
        for number, slot in self._slots_of(seen).items():
            entity, forces = f"{schema.CONSTRAINTS}/{seen.client}_{slot}", seen.constraints[number]
            if forces.shape[1]:
                ids = np.full(len(forces), number)
                self._made.add_series(entity, at.steps, forces)
                self._made.add_holders(entity, at.steps, ids)
                rows = np.column_stack((forces, ids))
                self._series.hold(entity, at, rows, kind=rows.shape[1])
        states = rows_of_bases(seen)
        self._made.tables[schema.STATES.entity].update(states)
        if len(states):
            self._tables[schema.STATES.entity].hold(
                schema.STATES.entity, at, states, kind=seen.client
            )
        if not self._is_held(len(seen.steps)):
            yield from self._flush()
        self._commands.on_samples(seen)
        if self.drawn:
            yield from self.drawing.on_samples(seen)

    def _on_frames(self, seen: Frames) -> None:
        """Add the replay frames of steps whose samples were added before."""
        row = packed(seen, self.bodies)
        self._made.add_steps(row)
        at = Times(np.array([seen.first + 1]), seen.clock_s[:1])
        self._frames.hold(schema.STEPS, at, row)

    def _slots_of(self, seen: Samples) -> dict[int, int]:
        """Return the entity slot of each constraint, perhaps that of a similar removed one.

        Slots are reused because Rerun keeps 25 kB of each entity in memory until the file is
        finished.
        """
        slots = self._slots.setdefault(seen.client, {})
        there = {(number, forces.shape[1]) for number, forces in seen.constraints.items()}
        gone = sorted(slots.keys() - there)
        for new in sorted(there - slots.keys()):
            free = next((each for each in gone if each[1] == new[1]), None)
            if free is not None:
                gone.remove(free)
                slots[new] = slots.pop(free)
            else:
                used = set(slots.values())
                slots[new] = next(each for each in itertools.count(new[0]) if each not in used)
        return {each[0]: slots[each] for each in sorted(there)}

    def _is_held(self, steps: int) -> bool:
        """Return whether a batch of steps should wait for more steps before it is written."""
        self._short += steps < SHORT
        if self._short <= MANY or steps >= SHORT:
            return False
        now_s = time.monotonic()
        if self._held_since_s is None:
            self._held_since_s = now_s
        return now_s - self._held_since_s < SOON_S

    def _flush(self) -> Iterator[Chunk]:
        """Yield all buffered rows as chunks.

        Bodies come before their samples, and contacts before the samples of their step, so that
        even a file that is cut off at any point has them.
        """
        self._held_since_s = None
        contacts, states = (self._tables[each.entity] for each in (schema.CONTACTS, schema.STATES))
        held = self._rows, self._calls, contacts, self._series, states, self._frames
        for gathered in held:
            yield from gathered.flush()

    def _add_contacts(
        self,
        client: int,
        rows: Rows,
        steps: Int64,
        times_s: Float64,
    ) -> None:
        """Add the contact points of several samples."""
        self._made.tables[schema.CONTACTS.entity].update(rows)
        if len(rows):
            touching = rows["step"][writer.first_of_steps(rows)]
            at = Times(touching, times_s[np.searchsorted(steps, touching)])
            entity = schema.CONTACTS.entity
            self._tables[entity].hold(entity, at, rows, kind=client)

    def _on_controls(self, seen: Controls) -> Iterator[Chunk]:
        """Yield the controls of actuators when they change."""
        entity = f"{schema.CONTROLS}/{seen.client}"
        if entity not in self._entities:
            yield writer.series_chunk(entity, seen.names, stepped=True)
        self._add_series(entity, Times(seen.steps, seen.times_s), seen.values)
        yield from self._series.flush()

    def _add_series(self, entity: str, at: Times, values: Float64) -> None:
        """Add rows of a series, with one value per row and joint."""
        if values.shape[1]:
            self._made.add_series(entity, at.steps, values)
            self._series.hold(entity, at, values, kind=values.shape[1])

    def take_in(self, event: Event) -> None:
        """Store a digest of each state, to compare this run with another."""
        if not isinstance(event, Samples) or not len(event.steps):
            return
        # Bodies are numbered in the order in which threads add them: theirs are left out.
        columns = [values for _, values in sorted(event.bases.items())]
        for _, joints in sorted(event.joints.items()):
            columns += [getattr(joints, name) for name in schema.OF_JOINTS]
        states = np.hstack([np.zeros((len(event.steps), 1)), *columns])
        digests = self._digests.setdefault(event.client, [])
        for step, row in zip(event.steps.tolist(), states, strict=True):
            digests.append((step, hashlib.blake2b(row.tobytes(), digest_size=8).digest()))

    def first_difference(self, other: Recorder) -> int | None:
        """Return the first step whose state differs from, or is missing in, another run."""
        mine, theirs = self._digests, other._digests
        if sorted(mine.values()) == sorted(theirs.values()):  # however threads took turns
            return None
        steps = [
            (one or another)[0]
            for client in mine.keys() | theirs.keys()
            for one, another in itertools.zip_longest(mine.get(client, ()), theirs.get(client, ()))
            if one != another
        ]
        return min(steps)

    # -- calls ------------------------------------------------------------------------------------

    def _on_calls(self, seen: Calls) -> Iterator[Chunk]:
        self._made.add_calls(seen, self.sites)
        widths = widths_of(seen, self.sites)
        at = Times(seen.steps, seen.times_s)
        self._calls.hold(schema.CALLS, at, (seen, widths), kind=seen.client)
        if not self._is_held(len(seen.steps)):
            yield from self._rows.flush()  # their sites
            yield from self._calls.flush()
        yield from self._commands.on_calls(seen, self.sites, widths)
        if self.drawn:
            yield from self.drawing.on_calls(seen, self.sites, widths)

    # -- everything else --------------------------------------------------------------------------

    def _on_image(self, image: Image) -> Iterator[Chunk]:
        number = self.cameras.setdefault(image.camera, len(self.cameras))
        png = pictures.png(image.rgba)
        self._on_frame(number, image.at.step, png)
        yield from self.drawing.on_image(number, image, png)

    def _on_frame(self, camera: int, step: int, png: bytes) -> None:
        self.frames += 1
        self._pictures.setdefault(camera, FrameDigest()).update(step, png)


def _table_chunk(entity: str, at: Times, parts: list[Rows]) -> Chunk:
    rows = parts[0] if len(parts) == 1 else np.concatenate(parts)  # without a copy of all
    return writer.rows_chunk(schema.TABLES[entity], rows, at)


def _series_chunk(entity: str, at: Times, parts: list[Float64]) -> Chunk:
    values = np.concatenate(parts)
    if not entity.startswith(f"{schema.CONSTRAINTS}/"):
        return writer.scalars_chunk(entity, at, values)
    ids = {schema.CONSTRAINT: values[:, -1].astype(np.int64)}
    return writer.scalars_chunk(entity, at, values[:, :-1], ids)


def _calls_chunk(_: str, __: Times, parts: list[tuple[Calls, Int64]]) -> Chunk:
    """Return a chunk of calls in one simulation, joined from parts."""
    columns = zip(*([*vars(calls).values()][1:] for calls, _ in parts), strict=True)
    whole = Calls(parts[0][0].client, *map(np.concatenate, columns))
    return writer.calls_chunk(whole, np.concatenate([widths for _, widths in parts]))


def _is_for_looking(entity: str) -> bool:
    ends = f"/{schema.TARGET}", f"/{schema.LIMIT}"
    of_motors = entity.startswith(f"{schema.JOINTS}/") and entity.endswith(ends)
    return of_motors or entity.startswith(schema.FOR_LOOKING)

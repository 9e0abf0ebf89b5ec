"""Reads a recording's samples by step range, from an index of the chunks on disk."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.recording import columns, rrd, schema
from drop_physics.recording.damage import damaged
from drop_physics.recording.first_look import unreadable
from drop_physics.recording.rrd import Chunk
from drop_physics.trace.events import Appearance, Impulses, Raised, Site
from drop_physics.trace.history import Piece
from drop_physics.trace.log import Log
from drop_physics.trace.states import Joints, Rows, between, in_step_order

HELD_BYTES = 1 << 24
"""Largest size of decoded chunks kept in memory [bytes], so that a small recording is decoded once.
"""


def is_series(entity: str) -> bool:
    """Return whether an entity has a row per step: of joints, constraints, or actuators."""
    kind, _, what = entity.partition("/")
    return kind in (schema.CONSTRAINTS, schema.CONTROLS) or (
        kind == schema.JOINTS and what.rpartition("/")[2] in schema.OF_JOINTS
    )


@dataclass
class Entity:
    """The chunks of one entity: their first and last steps, and positions in the file."""

    first: list[int] = field(default_factory=list)
    last: list[int] = field(default_factory=list)
    positions: list[int] = field(default_factory=list)
    in_order: bool = True
    """Whether each chunk begins after the end of the previous one."""

    def add(self, steps: Int64, position: int) -> None:
        """Add a chunk that has rows for these steps."""
        first, last = int(steps.min()), int(steps.max())
        self.in_order &= not self.last or first > self.last[-1]
        self.first.append(first)
        self.last.append(last)
        self.positions.append(position)

    def within(self, first: int, end: int) -> list[int]:
        """Return the positions of the chunks that have steps from `first` to before `end`."""
        of_piece = (np.array(self.last) >= first) & (np.array(self.first) < end)
        return [self.positions[number] for number in np.flatnonzero(of_piece).tolist()]


class RecordedSamples:
    """A recording's samples, calls and images, indexed; the data stay on disk."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.entities: dict[str, Entity] = {}
        self.pictures: dict[str, list[int]] = {}
        """Positions of each camera's chunks."""
        self._held: dict[int, Chunk] = {}
        self._room = HELD_BYTES
        self.sites: Mapping[int, Site] = {}
        self.raised: list[Raised] = []
        self.appearances: list[Appearance] = []
        self.numbers: Mapping[str, int] = {}
        """Ids of the bodies, by label."""
        self.whole: int | None = None
        """The last complete step of an unfinished recording; None for a finished one."""
        self.causes: Collection[int] = ()
        """Numbers of the known causes of impulses."""

    @property
    def last(self) -> int:
        """The last complete step that has any data; -1 if there is none."""
        if self.whole is not None:
            return self.whole
        return max((max(entity.last, default=-1) for entity in self.entities.values()), default=-1)

    @property
    def first(self) -> int:
        """The first step that has any data; 0 if there is none."""
        return min((min(entity.first, default=0) for entity in self.entities.values()), default=0)

    def add(self, chunk: Chunk, steps: Int64) -> None:
        """Add a chunk of samples or calls to the index."""
        if len(steps):
            self.entities.setdefault(chunk.entity, Entity()).add(steps, chunk.position)
            self._hold(chunk)

    def add_picture(self, chunk: Chunk) -> None:
        """Add a chunk of a camera's frames to the index."""
        self.pictures.setdefault(chunk.entity, []).append(chunk.position)
        self._hold(chunk)

    def _hold(self, chunk: Chunk) -> None:
        if chunk.size <= self._room:
            self._room -= chunk.size
            self._held[chunk.position] = chunk

    def chunks(self, entity: str, first: int, end: int) -> Iterator[Chunk]:
        """Yield an entity's chunks that have steps from `first` to before `end`, as `chunks_at`."""
        found = self.entities.get(entity)
        return iter(()) if found is None else self.chunks_at(found.within(first, end))

    def chunks_at(self, positions: Iterable[int]) -> Iterator[Chunk]:
        """Yield the chunks at these positions in the file.

        Raises
        ------
        RecordingError
            If the file was changed or deleted after it was indexed.
        """
        try:
            with self.path.open("rb") as file:
                for position in positions:
                    yield self._held.get(position) or rrd.chunk_at(file, position)
        except rrd.DamagedError as error:
            raise damaged(self.path, error.what) from None
        except OSError as error:
            raise unreadable(self.path, error) from None

    def piece(self, first: int, end: int) -> Piece:
        """Return the samples of the steps from `first` to before `end`."""
        end = min(end, self.last + 1)
        bases = self.table(schema.STATES.entity, first, end)
        contacts = self.table(schema.CONTACTS.entity, first, end)
        joints = {}
        forces: dict[tuple[int, int], list[tuple[Int64, Float64]]] = {}
        for label, number in self.numbers.items():
            held = [
                self.series(f"{schema.JOINTS}/{label}/{name}", first, end)
                for name in schema.OF_JOINTS
            ]
            if len(held[0][0]):
                (steps, position), (_, velocity), (_, effort) = held
                nowhere = np.full(len(steps), np.nan)
                if len(effort) != len(steps):  # of an engine that reports none
                    effort = np.zeros((len(steps), 0))
                joints[number] = Joints(steps, nowhere, position, velocity, effort)
        for entity in self.entities:
            if entity.startswith(f"{schema.CONSTRAINTS}/"):
                client = int(entity.rpartition("/")[2].partition("_")[0])
                for chunk in self.chunks(entity, first, end):
                    if (read := columns.series(chunk, self.path)) is not None:
                        ids = columns.holders(chunk, self.path)
                        for number in np.unique(ids).tolist():
                            its = read[0][ids == number], read[1][ids == number]
                            forces.setdefault((client, number), []).append(its)
        return Piece(
            first,
            end,
            bases,
            joints,
            {each: _joined(parts, first, end) for each, parts in forces.items()},
            contacts,
            self.calls(first, end),
            impulses=self._impulses(first, end),
            controls=self._controls(first, end),
        )

    def _impulses(self, first: int, end: int) -> dict[int, list[Impulses]]:
        """Return the impulses of the given steps, by simulation."""
        found = {}
        for entity in self.entities:
            if entity.startswith(f"{schema.IMPULSES}/"):
                read = [
                    columns.impulses(chunk, self.path) for chunk in self.chunks(entity, first, end)
                ]
                known = read if self.whole is None else [*filter(self._is_known, read)]
                if known:
                    client = int(entity.rpartition("/")[2])
                    found[client] = [each.between(first, end) for each in known]
        return found

    def _is_known(self, acted: Impulses) -> bool:
        """Return whether all causes of impulses are described in the recording."""
        return bool(np.isin(acted.causes, [*self.causes]).all())

    def _controls(self, first: int, end: int) -> dict[int, tuple[Int64, Float64]]:
        """Return the controls of actuators by simulation, with the last row before `first`."""
        found = {}
        for entity, held in self.entities.items():
            if entity.startswith(f"{schema.CONTROLS}/"):
                before = [step for step in held.first if step < first]
                begin = max(before, default=first)
                found[int(entity.rpartition("/")[2])] = self.series(entity, begin, end)
        return found

    def table(self, entity: str, first: int, end: int) -> Rows:
        """Return the rows of states or contacts, sorted by step."""
        table = schema.TABLES[entity]
        parts = [
            between(in_step_order(columns.rows(chunk, table, self.path)), first, end)
            for chunk in self.chunks(entity, first, end)
        ]
        return in_step_order(np.concatenate([np.empty(0, table.kind), *parts]))

    def series(self, entity: str, first: int, end: int) -> tuple[Int64, Float64]:
        """Return steps and values of a series, sorted by step."""
        parts = [columns.series(chunk, self.path) for chunk in self.chunks(entity, first, end)]
        return _joined([part for part in parts if part is not None], first, end)

    def calls(self, first: int, end: int) -> Log:
        """Return the calls made after `first` or more, and fewer than `end`, steps."""
        chunks = self.chunks(schema.CALLS, first, end)
        read = [columns.calls(chunk, self.path) for chunk in chunks]
        return Log(read, self.sites, self.raised, self.appearances).between(first, end)


def _joined(parts: list[tuple[Int64, Float64]], first: int, end: int) -> tuple[Int64, Float64]:
    """Concatenate steps from `first` to before `end`, sorted, with their values."""
    if not parts:
        return np.empty(0, np.int64), np.empty((0, 0))
    steps = np.concatenate([steps for steps, _ in parts])
    # An id that is used again may be that of a constraint with other forces.
    widest = max(values.shape[1] for _, values in parts)
    values = np.concatenate(
        [
            np.pad(values, ((0, 0), (0, widest - values.shape[1])), constant_values=np.nan)
            for _, values in parts
        ]
    )
    order = np.argsort(steps, kind="stable")
    order = order[(steps[order] >= first) & (steps[order] < end)]
    return steps[order], values[order]

"""Explanations of steps that were computed after recording."""

from __future__ import annotations

import pickle
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from drop_physics.trace.events import ContactRows, Event, ImpulseCause, Impulses, PairFriction
from drop_physics.trace.history import Piece, Sampled, Seen
from drop_physics.trace.states import between, in_step_order

Window = tuple[int, int, int]
"""A range of steps of one simulation: client, first and end (exclusive), by start sample."""


class EventPlace(NamedTuple):
    """Position of an event in a file, and the samples that it covers."""

    first: int
    """Index of the first sample."""
    end: int
    """Index after the last sample."""
    at: int
    """Byte offset in the file."""


class LaterSums:
    """Impulses and contact points of explained step ranges, in a temporary file."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by the next line
        weakref.finalize(self, self._file.close)
        self._places: list[EventPlace] = []
        self.windows: list[Window] = []
        """The ranges of explained steps."""
        self.causes: dict[int, ImpulseCause] = {}
        self.pairs: list[PairFriction] = []

    def add(self, events: Iterable[Event]) -> None:
        """Add the events of explained steps."""
        for event in events:
            match event:
                case ImpulseCause():
                    self.causes[event.number] = event
                case PairFriction():
                    self.pairs.append(event)
                case Impulses() | ContactRows() if len(event.steps):
                    first, end = int(event.steps[0]), int(event.steps[-1]) + 1
                    self._places.append(EventPlace(first, end, self._file.seek(0, 2)))
                    pickle.dump(event, self._file, pickle.HIGHEST_PROTOCOL)
                    if isinstance(event, Impulses):
                        self.windows.append((event.client, first - 1, end - 1))

    def within(self, first: int, end: int) -> Iterator[Impulses | ContactRows]:
        """Yield the events of steps that lead to samples from `first` to before `end`."""
        for place in self._places:
            if place.first < end and place.end > first:
                self._file.seek(place.at)
                yield pickle.load(self._file)

    def lacking(self, wanted: Iterable[Window]) -> list[Window]:
        """Return the wanted step ranges without the steps that are already explained."""
        found: list[Window] = []
        for client, first, end in wanted:
            begin = first
            for _, a, b in sorted(window for window in self.windows if window[0] == client):
                if b > begin and a < end:
                    if a > begin:
                        found.append((client, begin, a))
                    begin = max(begin, b)
            if begin < end:
                found.append((client, begin, end))
        return found

    def seen(self, seen: Seen, *, whole: bool) -> Seen:
        """Return a record with the impulse causes added; `whole` if all steps are explained."""
        pairs = {(pair.body_a, pair.link_a, pair.body_b, pair.link_b): pair for pair in self.pairs}
        return replace(
            seen,
            sampled=WithSums(seen.sampled, self),
            windows=() if whole else _joined(self.windows),
            causes={**seen.causes, **self.causes},
            frictions={**seen.frictions, **{key: pair.friction for key, pair in pairs.items()}},
            softness={
                **seen.softness,
                **{key: (pair.solref, pair.solimp) for key, pair in pairs.items() if pair.solref},
            },
            condims={
                **seen.condims,
                **{key: (pair.condim, pair.rolling) for key, pair in pairs.items()},
            },
        )


def _joined(windows: Iterable[Window]) -> list[Window]:
    """Merge the step ranges of a simulation that touch or overlap."""
    found: list[Window] = []
    for client, first, end in sorted(windows):
        if found and found[-1][0] == client and first <= found[-1][2]:
            found[-1] = client, found[-1][1], max(end, found[-1][2])
        else:
            found.append((client, first, end))
    return found


class WithSums:
    """Samples, completed by explanations that were added later."""

    def __init__(self, samples: Sampled, sums: LaterSums) -> None:
        self._samples, self._sums = samples, sums

    @property
    def first(self) -> int:
        """The first step with any sample."""
        return self._samples.first

    @property
    def last(self) -> int:
        """The last step with any sample."""
        return self._samples.last

    def piece(self, first: int, end: int) -> Piece:
        """Return the samples of the steps from `first` up to, not including, `end`."""
        piece = self._samples.piece(first, end)
        contacts = [piece.contacts]
        impulses = {client: [*parts] for client, parts in piece.impulses.items()}
        for event in self._sums.within(first, end):
            if isinstance(event, Impulses):
                impulses.setdefault(event.client, []).append(event.between(first, end))
            else:
                contacts.append(between(event.contacts, first, end))
        in_order = {
            client: sorted((part for part in parts if len(part.steps)), key=_first)
            for client, parts in impulses.items()
        }
        rows = in_step_order(np.concatenate(contacts))
        return replace(piece, contacts=rows, impulses=in_order)


def _first(acted: Impulses) -> int:
    return int(acted.steps[0])

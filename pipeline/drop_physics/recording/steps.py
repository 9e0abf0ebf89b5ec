"""Reads compiled models and replay frames, with which the engine can repeat recorded steps."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.recording import columns, schema
from drop_physics.recording.damage import damaged
from drop_physics.recording.rrd import Chunk
from drop_physics.recording.sampled import RecordedSamples
from drop_physics.recording.step_frames import PackedFrames, edits_of, inflated, span_of, unpacked
from drop_physics.trace.frames import Frames, ModelEdit, ModelPart


class _Place(NamedTuple):
    """The location of a batch's replay frames in the file."""

    first: int
    """Index of the sample from which the first step starts."""
    end: int
    """Index of the sample after the last step."""
    model: int
    chunk: int
    row: int
    edited: bool


class RecordedModel(NamedTuple):
    """A recorded compiled model."""

    engine: str
    """Name and version of the engine, which alone can load the model."""
    sha256: str
    size: int
    """Size of the model [bytes]."""


@dataclass
class RecordedSteps:
    """A recording's models and replay frames, indexed; the data stay on disk."""

    samples: RecordedSamples
    models: dict[int, RecordedModel] = field(default_factory=dict)
    """The models that were stepped, by number."""
    _parts: dict[int, list[tuple[int, int]]] = field(default_factory=dict)
    """Offsets of the parts of each model, and their chunks."""
    _places: dict[int, list[_Place]] = field(default_factory=dict)
    """Positions in the file of each simulation's frames, in order."""

    @property
    def clients(self) -> list[int]:
        """Ids of the simulations that have replay frames."""
        return sorted(self._places)

    def ends(self, client: int) -> list[int]:
        """Return the samples at which the batches of a simulation end."""
        return [place.end for place in self._places.get(client, ())]

    def add_model(self, chunk: Chunk, part: ModelPart) -> None:
        """Add a part of a model to the index."""
        self.models[part.number] = RecordedModel(part.engine, part.sha256, part.size)
        self._parts.setdefault(part.number, []).append((part.at, chunk.position))

    def add_frames(self, chunk: Chunk, row: PackedFrames, number: int) -> None:
        """Add a chunk's row of replay frames to the index."""
        its = span_of(row)
        end = its.first + its.steps
        place = _Place(its.first, end, its.model, chunk.position, number, its.edited)
        insort(self._places.setdefault(its.client, []), place)

    def model(self, number: int) -> bytes:
        """Return a compiled model in its engine's binary format.

        Raises
        ------
        RecordingError
            If the file has changed since it was indexed.
        """
        parts = {
            part.at: part.data
            for chunk in self.samples.chunks_at(at for _, at in self._parts[number])
            for part in columns.model_parts(chunk, self.samples.path)
            if part.number == number
        }
        try:
            return b"".join(inflated(data) for _, data in sorted(parts.items()))
        except ValueError:
            what = Message("{entity} is not in drop's format", entity=schema.MODELS)
            raise damaged(self.samples.path, what) from None

    def model_of(self, client: int) -> int:
        """Return the index of a simulation's model."""
        return self._places[client][0].model

    def steps_of(self, client: int) -> int:
        """Return the number of a simulation's steps."""
        return self._places[client][-1].end

    def edits(self, client: int, end: int) -> list[ModelEdit]:
        """Return the script's edits of a model before sample `end`, batch by batch.

        Raises
        ------
        RecordingError
            As for `pieces`.
        """
        found: list[ModelEdit] = []
        for place in self._places.get(client, ()):
            if place.edited and place.end <= end:
                found += edits_of(self._row(place))
        return found

    def _row(self, place: _Place) -> PackedFrames:
        (chunk,) = self.samples.chunks_at([place.chunk])
        return [*columns.steps(chunk, self.samples.path)][place.row]

    def pieces(self, client: int, first: int, end: int) -> Iterator[Frames]:
        """Yield replay frames of the batches with steps from sample `first` to before `end`.

        Raises
        ------
        RecordingError
            If frames are not as drop writes them, or the file has changed since it was indexed.
        """
        path, appearances = self.samples.path, self.samples.appearances
        numbers = {appearance.body.label: appearance.body.number for appearance in appearances}
        for place in self._places.get(client, ()):
            if place.end <= first or place.first >= end:
                continue

            def series(label: str, of: str, place: _Place = place) -> Float64:
                entity = f"{schema.JOINTS}/{label}/{of}"
                return self.samples.series(entity, place.first + 1, place.end + 1)[1]

            try:
                yield unpacked(self._row(place), numbers, series)
            except (ValueError, LookupError, TypeError):
                if self.samples.whole is not None:  # its last samples may be missing
                    return
                what = Message("{entity} is not in drop's format", entity=schema.STEPS)
                raise damaged(path, what) from None

"""Computes digests of all recorded data from which results or images are computed.

The digests are written last, into the recording's closing property, and checked before any data are
used, so that a flipped bit on the disk counts as damage and does not change a result.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.recording import schema
from drop_physics.recording.step_frames import PackedFrames
from drop_physics.trace.events import Calls, Impulses, Site, widths_of


class RowsDigest:
    """SHA-256 of rows of states or contacts in step order, however they are split into chunks."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def update(self, rows: NDArray[Any]) -> None:
        """Add rows, hashed as little-endian numbers according to their dtype."""
        self._hash.update(np.ascontiguousarray(rows).view(np.uint8).data)

    def hexdigest(self) -> str:
        """Return the digest of all rows so far."""
        return self._hash.hexdigest()


class RowsInAnyOrder:
    """SHA-256 of rows that may be read in another order than they were written."""

    def __init__(self) -> None:
        self._digests = bytearray()

    def add(self, *parts: bytes | memoryview) -> None:
        """Add one row."""
        made = hashlib.sha256()
        for part in parts:
            made.update(part)
        self._digests += made.digest()

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._digests) // 32

    def hexdigest(self) -> str:
        """Return the digest of all rows so far."""
        # A tool that splits a recording by time repeats what holds at the beginning of a part.
        digests = np.unique(np.frombuffer(bytes(self._digests), "V32").view("S32"))
        return hashlib.sha256(digests.tobytes()).hexdigest()


class ToldDigest(RowsInAnyOrder):
    """SHA-256 of rows of JSON, which a recording stores by entity path."""

    def update(self, entity: str, step: int, call: int, text: str) -> None:
        """Add one row."""
        self.add(json.dumps([entity, step, call, text]).encode())


class CallsDigest:
    """SHA-256 of the calls of one simulation, in order, however they are split into chunks."""

    def __init__(self) -> None:
        self._heads, self._numbers = RowsDigest(), RowsDigest()

    def update(self, seen: Calls, widths: Int64) -> None:
        """Add calls, each with its number of numeric values."""
        heads = np.column_stack((seen.steps, seen.calls, seen.sites, widths))
        self.add(np.hstack((heads.view(np.float64), seen.results[:, None])), seen.numbers)

    def add(self, heads: Float64, numbers: Float64) -> None:
        """Add rows of numbers, each preceded by its binary header."""
        self._heads.update(heads)
        self._numbers.update(numbers)

    def hexdigest(self) -> str:
        """Return the digest of all calls so far."""
        return hashlib.sha256(
            (self._heads.hexdigest() + self._numbers.hexdigest()).encode()
        ).hexdigest()


class Digests:
    """Digests of a recording's data, updated while these are written or read."""

    def __init__(self) -> None:
        self.tables = {entity: RowsDigest() for entity in schema.TABLES}
        self._series: dict[str, RowsDigest] = {}
        """Digests of joints and constraints, by entity."""
        self._calls: dict[int, CallsDigest] = {}
        """Digests of calls, by simulation."""
        self._impulses: dict[int, CallsDigest] = {}
        self._models, self._steps = RowsInAnyOrder(), RowsInAnyOrder()

    def add_series(self, entity: str, steps: Int64, values: NDArray[Any]) -> None:
        """Add rows of a series."""
        numbers = np.column_stack((steps.astype(np.float64), values))
        self._series.setdefault(entity, RowsDigest()).update(numbers)

    def add_holders(self, entity: str, steps: Int64, ids: Int64) -> None:
        """Add an entity's constraint ids where they differ from the id in its name."""
        others = ids != int(entity.rpartition("_")[2])
        if others.any():
            self.add_series(f"{entity}_", steps[others], ids[others])

    def add_calls(self, seen: Calls, sites: Mapping[int, Site]) -> None:
        """Add the calls of one simulation."""
        self._calls.setdefault(seen.client, CallsDigest()).update(seen, widths_of(seen, sites))

    def add_impulses(self, seen: Impulses) -> None:
        """Add the impulses of one simulation's steps."""
        heads = np.column_stack((seen.steps, seen.status, seen.counts, seen.widths))
        digest = self._impulses.setdefault(seen.client, CallsDigest())
        digest.add(np.hstack((heads.view(np.float64), seen.remainder[:, None])), seen.values)
        digest.add(seen.causes.view(np.float64), np.empty(0))

    def add_model(self, number: int, at: int, data: bytes) -> None:
        """Add a part of a compiled model."""
        self._models.add(f"{number} {at} ".encode(), data)

    def add_steps(self, row: PackedFrames) -> None:
        """Add the replay frames of a batch of steps."""
        numbers, at = (np.ascontiguousarray(each).view(np.uint8).data for each in row[1:3])
        self._steps.add(row.layout.encode(), numbers, at, row.answers)

    @property
    def models(self) -> str | None:
        """Digest of the compiled models; None without models."""
        return self._models.hexdigest() if len(self._models) else None

    @property
    def steps(self) -> str | None:
        """Digest of the replay frames; None if there are none."""
        return self._steps.hexdigest() if len(self._steps) else None

    @property
    def impulses(self) -> list[str] | None:
        """Digests of impulses, in the order of simulations; None without impulses."""
        return [each.hexdigest() for _, each in sorted(self._impulses.items())] or None

    @property
    def series(self) -> list[str] | None:
        """Digests of all series, in the order of their entities; None without series."""
        return [each.hexdigest() for _, each in sorted(self._series.items())] or None

    @property
    def calls(self) -> list[str] | None:
        """Digests of all calls, in the order of simulations; None without calls."""
        return [each.hexdigest() for _, each in sorted(self._calls.items())] or None


class FrameDigest:
    """SHA-256 of camera frames in step order."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def update(self, step: int, png: bytes) -> None:
        """Add one frame."""
        self._hash.update(step.to_bytes(8, "little") + len(png).to_bytes(8, "little") + png)

    def hexdigest(self) -> str:
        """Return the digest of all frames so far."""
        return self._hash.hexdigest()


def inputs_digest(properties: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the SHA-256 of properties, which is the same before writing and after reading."""
    plain = {name: _plain(values) for name, values in properties.items()}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def closing_digest(closing: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the property that ends a recording, without its `digest` field."""
    return inputs_digest({"closing": {k: v for k, v in closing.items() if k != "closing_sha256"}})


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert values to the form in which they are read: no None, one-element lists as elements."""
    return {
        key: value[0] if isinstance(value, list | tuple) and len(value) == 1 else value
        for key, value in values.items()
        if value is not None
    }

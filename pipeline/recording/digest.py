"""Digests of everything that a number or a picture is made from.

They are written last, into the recording's closing property, and checked before anything is
believed: a bit that changed on the disk is damage, not a result.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class RowsDigest:
    """SHA-256 over rows of states or contacts in step order: the same however they were chunked."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def update(self, rows: NDArray[Any]) -> None:
        """Take in rows, whose numbers are little-endian by their dtype."""
        self._hash.update(np.ascontiguousarray(rows).view(np.uint8).data)

    def hexdigest(self) -> str:
        """Return the digest of all rows so far."""
        return self._hash.hexdigest()


class ToldDigest:
    """SHA-256 over what was told of a script: rows of named lists, in whatever order they come.

    A recording holds them by entity and by columns, and so not in the order that they had.
    """

    def __init__(self) -> None:
        self._marks = bytearray()

    def update(self, entity: str, step: int, call: int, values: Mapping[str, list[Any]]) -> None:
        """Take in one row."""
        told = json.dumps([entity, step, call, values], sort_keys=True).encode()
        self._marks += hashlib.sha256(told).digest()

    def hexdigest(self) -> str:
        """Return the digest of all rows so far."""
        marks = np.sort(np.frombuffer(bytes(self._marks), "V32").view("S32"))
        return hashlib.sha256(marks.tobytes()).hexdigest()


class FrameDigest:
    """SHA-256 over the camera frames in step order."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def update(self, step: int, png: bytes) -> None:
        """Take in one frame."""
        self._hash.update(step.to_bytes(8, "little") + len(png).to_bytes(8, "little") + png)

    def hexdigest(self) -> str:
        """Return the digest of all frames so far."""
        return self._hash.hexdigest()


def inputs_digest(properties: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the SHA-256 of properties by name, the same before writing and after reading."""
    plain = {name: _plain(values) for name, values in properties.items()}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def closing_digest(closing: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a script's closing property, but for the digest itself."""
    return inputs_digest({"closing": {k: v for k, v in closing.items() if k != "closing_sha256"}})


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as they are read back: None is not written, a list of one is its element."""
    return {
        key: value[0] if isinstance(value, list | tuple) and len(value) == 1 else value
        for key, value in values.items()
        if value is not None
    }

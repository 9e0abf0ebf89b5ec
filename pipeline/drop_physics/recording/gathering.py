"""Buffers rows by entity path, since one chunk of many rows is cheaper than many of one row."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Any

import numpy as np
from rerun.chunk import Chunk

from drop_physics.recording.writer import Times


class Gathering:
    """A buffer of rows, which become chunks once there are enough.

    Parameters
    ----------
    make
        A function that makes a chunk from an entity path, the rows' times, and the list of their
        values.
    most
        The number of rows of all entities together that are buffered.
    """

    def __init__(self, make: Callable[[str, Times, list[Any]], Chunk], *, most: int) -> None:
        self._make, self._most = make, most
        self._held: dict[tuple[str, object], list[tuple[Times, Any]]] = {}
        self._rows = 0

    def add(self, entity: str, at: Times, values: Any) -> Iterator[Chunk]:  # noqa: ANN401
        """Buffer rows of an entity, and yield chunks once there are enough."""
        self.hold(entity, at, values)
        if self._rows >= self._most:
            yield from self.flush()

    def hold(
        self,
        entity: str,
        at: Times,
        values: Any,  # noqa: ANN401
        *,
        kind: Hashable = None,
    ) -> None:
        """Buffer rows of an entity; rows of another `kind` are put into separate chunks."""
        self._held.setdefault((entity, kind), []).append((at, values))
        self._rows += len(at.steps)

    def __len__(self) -> int:
        """Return the number of buffered rows."""
        return self._rows

    def flush(self) -> Iterator[Chunk]:
        """Yield all buffered rows as chunks."""
        held, self._held, self._rows = self._held, {}, 0
        for (entity, _), rows in held.items():
            yield self._make(
                entity, _joined([at for at, _ in rows]), [values for _, values in rows]
            )


def _joined(times: list[Times]) -> Times:
    calls = [at.calls for at in times if at.calls is not None]
    return Times(
        np.concatenate([at.steps for at in times]),
        np.concatenate([at.times_s for at in times]),
        np.concatenate(calls) if len(calls) == len(times) else None,
    )

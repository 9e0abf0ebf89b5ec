"""Rows that come one by one, gathered by entity: a chunk of many costs what one of one does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from rerun.chunk import Chunk

from pipeline.recording.writer import Times


class Gathering:
    """What is to become chunks.

    Parameters
    ----------
    make
        Makes a chunk of an entity's rows: it gets their values as a list, in order.
    most
        Rows, of all entities together, that are held.
    """

    def __init__(self, make: Callable[[str, Times, list[Any]], Chunk], *, most: int) -> None:
        self._make, self._most = make, most
        self._held: dict[tuple[str, object], list[tuple[Times, Any]]] = {}
        self._rows = 0

    def add(self, entity: str, at: Times, values: Any) -> Iterator[Chunk]:  # noqa: ANN401
        """Take in rows of an entity; yields chunks when there are enough of them."""
        kind = tuple(values) if isinstance(values, Mapping) else None  # other columns, other chunk
        self._held.setdefault((entity, kind), []).append((at, values))
        self._rows += len(at.steps)
        if self._rows >= self._most:
            yield from self.flush()

    def flush(self) -> Iterator[Chunk]:
        """Yield everything that is held."""
        held, self._held, self._rows = self._held, {}, 0
        for (entity, _), ones in held.items():
            yield self._make(entity, _joined([at for at, _ in ones]), [one for _, one in ones])


def _joined(times: list[Times]) -> Times:
    calls = [one.calls for one in times if one.calls is not None]
    return Times(
        np.concatenate([one.steps for one in times]),
        np.concatenate([one.times_s for one in times]),
        np.concatenate(calls) if len(calls) == len(times) else None,
    )

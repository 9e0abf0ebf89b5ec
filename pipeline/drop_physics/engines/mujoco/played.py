"""Replays the recorded actuator controls of one run in a repeated run."""

from __future__ import annotations

import numpy as np

from drop_physics.engines.interventions import Operation
from drop_physics.engines.mujoco.watch.single_changes import ENGINE
from drop_physics.trace.history import Seen


def played(seen: Seen, client: int, first: int, last: int) -> list[Operation]:
    """Return the operation that feeds recorded controls to the steps between two samples.

    The list is empty if no controls were recorded.
    """
    piece = seen.sampled.piece(first + 1, last + 1)
    ends, rows = piece.controls.get(client, (np.zeros(0, np.int64), np.zeros((0, 0))))
    if not len(ends):
        return []
    begins = np.maximum(ends - 1, first).tolist()
    how = "played", [*begins, last], rows.tolist()
    ids = [*range(rows.shape[1])]
    return [{"engine": ENGINE, "do": "input", "part": "ctrl", "ids": ids, "how": how}]

"""Whether an engine's numbers can be recorded."""

from __future__ import annotations

import numpy as np

from drop_physics.engine_report import LARGEST
from drop_physics.errors import DropError
from drop_physics.trace.states import Rows


def check_numbers(rows: Rows) -> None:
    """Make sure that states or contacts are numbers that a recording can hold.

    Raises
    ------
    DropError
        If one is not finite, or too large.
    """
    lost = np.zeros(len(rows), dtype=bool)
    for name in rows.dtype.names or ():
        values = rows[name]
        if values.dtype.kind == "f":
            lost |= ~(np.abs(values) <= LARGEST).all(axis=tuple(range(1, values.ndim)))
    if lost.any():
        raise non_finite(rows["step"][lost][0])


def non_finite(step: int) -> DropError:
    """Return the error for an engine whose state is no longer finite."""
    return DropError(
        "the engine's state becomes non-finite at step {step} (or over {largest:g}); try "
        "a shorter --timestep, less --spin or --velocity, or another --body",
        step=step,
        largest=LARGEST,
    )

"""Finds periods in which values hardly change."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.rules.thresholds import SINKS_STEPS, STEADY_SHARE


def is_steady(values: Float64) -> Flags:
    """Flag the steps, shape (n,), whose values have hardly changed over the last SINKS_STEPS."""
    columns = values if values.ndim > 1 else values[:, None]
    found = np.zeros(len(columns), np.bool_)
    if len(columns) >= SINKS_STEPS:
        last = np.lib.stride_tricks.sliding_window_view(columns, SINKS_STEPS, axis=0)
        change = np.linalg.norm(np.ptp(last, axis=2), axis=1)
        size = np.linalg.norm(last, axis=1).max(axis=1)
        found[SINKS_STEPS - 1 :] = change <= STEADY_SHARE * size
    return found

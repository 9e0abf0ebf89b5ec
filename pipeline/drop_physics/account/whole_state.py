"""Finds linear feedback from all joints' states in a script's controls, and its delay.

A linear controller gives u = K x(t - l) + c, where x is the state of all joints. Its delay (l) is
found by least squares: the right one leaves nothing but rounding, all others leave much more. Where
all delays fit, as in a motion that is linear itself, or none fits, as for a neural network, the
delay is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64

SPARE, ENOUGH = 2, 8
"""Minimum number of distinct controls beyond the number of gains, and preferred number: even two
extra controls are not fitted exactly by chance."""
EXACT, APART = 1e-9, 1e3
"""Maximum share of a control that the right state leaves unexplained, and factor by which all other
delays leave more."""
ENTERS = 1e-3
"""Minimum share of a control that a joint must contribute for its state to count as an input."""


@dataclass(frozen=True)
class StateLaw:
    """A linear feedback law: the joints whose states a control was computed from, and the delay."""

    late: int
    """Delay of the state, in controls."""
    shares: Float64
    """Contribution of each joint to the control, as a share of its size, shape (joints,)."""

    def follows(self, own: int) -> int:
        """Return the joint that a control mainly follows: its own joint if that is an input."""
        return own if self.shares[own] > ENTERS else int(np.argmax(self.shares))


def state_law_of(
    control: Float64, position: Float64, rate: Float64, kept: Flags, latest: int
) -> StateLaw | None:
    """Fit a control by a linear law of the joints' states; None if no law fits.

    Parameters
    ----------
    control
        n equally spaced controls, shape (n,).
    position, rate
        The states at the start of the steps in which the controls act, shape (n, joints).
    kept
        Flags of the controls that are not clamped, shape (n,).
    latest
        The largest delay, in controls.
    """
    size = float(np.linalg.norm(control[kept] - control[kept].mean())) if kept.any() else 0.0
    states = np.hstack([position, rate, np.ones((len(control), 1))])
    states /= np.maximum(np.abs(states).max(axis=0), 1e-300)
    fits: list[tuple[float, Float64]] = []
    for late in range(latest + 1):
        rows = (np.flatnonzero(kept[late:]) + late)[-(states.shape[1] + ENOUGH) :]
        if not size or len(np.unique(control[rows])) < states.shape[1] + SPARE:
            break
        x, y = states[rows - late], control[rows]
        gains, *_ = np.linalg.lstsq(x, y, rcond=None)
        parts = np.linalg.norm(x - x.mean(axis=0), axis=0) * np.abs(gains) / size
        fits.append((float(np.linalg.norm(y - x @ gains)) / size, parts))
    left = np.array([each for each, _ in fits])
    if len(left) < 2 or not left.min() < EXACT:
        return None
    late = int(np.argmin(left))
    if not np.delete(left, late).min() > APART * max(left[late], 1e-12):
        return None
    joints = position.shape[1]
    return StateLaw(late, fits[late][1][: 2 * joints].reshape(2, joints).max(axis=0))

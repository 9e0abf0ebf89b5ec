"""Checks that an engine's numbers are finite, and converts them to samples of a drop."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.engine_report import LARGEST
from drop_physics.errors import DropError
from drop_physics.trace.events import Samples
from drop_physics.trace.states import BODY, CONTACT, Joints, Rows


def drop_samples(
    steps: Int64, timestep_s: float, base: Float64, contacts: Rows, joints: Joints | None = None
) -> Samples:
    """Return consecutive samples of a drop.

    Parameters
    ----------
    steps
        Step numbers of the samples, shape (n,).
    timestep_s
        Time between two steps [s].
    base
        States of the body's base, in the layout of `MOTION`, shape (n, 13).
    contacts
        The contact points, of dtype `CONTACT`.
    joints
        The joints of the body; None if no joint moves.

    Raises
    ------
    DropError
        If a number is not finite, or too large for a recording.
    """
    # A contact point begins with five whole numbers: its step, and which links it is of.
    points = contacts.view(np.float64).reshape(-1, CONTACT.itemsize // 8)[:, 5:]
    driven = () if joints is None else (joints.position, joints.velocity, joints.effort)
    for of, values in (
        (steps, base),
        (contacts["step"], points),
        *((steps, each) for each in driven),
    ):
        lost = ~(np.abs(values) <= LARGEST).all(axis=1)
        if lost.any():
            raise non_finite(int(of[lost][0]))
    return Samples(
        client=0,
        steps=steps,
        times_s=np.asarray(steps * timestep_s, dtype=np.float64),
        call=0,
        bases={BODY: base},
        joints={} if joints is None else {BODY: joints},
        contacts=contacts,
        constraints={},
    )


def non_finite(step: int) -> DropError:
    """Return the error for an engine whose state is not finite."""
    return DropError(
        "the engine's state becomes non-finite at step {step} (or over {largest:g}); try "
        "a shorter --timestep, less --spin or --velocity, or another --body",
        step=step,
        largest=LARGEST,
    )

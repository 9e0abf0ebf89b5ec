"""Sensor readings of a MuJoCo model, and lengths and forces of its tendons and actuators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import GEOMS, Arrays, DescribedModel, size_of, xyzw
from drop_physics.physics.rotations import products, rotate_inverse
from drop_physics.trace.events import FORCE, LENGTH, TENDON, At, Collision, Sensor
from drop_physics.trace.readings import Answer
from drop_physics.trace.states import BASE

KINDS = (
    *("touch", "accelerometer", "velocimeter", "gyro", "force", "torque"),
    *("magnetometer", "rangefinder"),
)
"""The first sensor types (`mjtSensor`), all of which are attached to sites."""
MOST = 256
"""Largest number of sensors of a model that are reported."""


def sensors_of(
    described: DescribedModel, client: int, kept: NDArray[np.float64]
) -> Iterator[Sensor]:
    """Yield a model's sensors with the first, last, least and greatest value of each reading.

    `kept` has the shape (4, numbers): first, last, least and greatest value of the sensor readings,
    then of the tendons' lengths, then of the actuators' lengths and forces.
    """
    arrays = described.arrays
    others = ((TENDON, "tendon"), (LENGTH, "actuator"), (FORCE, "actuator"))
    at = kept.shape[1] - sum(len(described.names[element]) for _, element in others)
    for kind, element in others:
        for number, name in enumerate(described.names[element]):
            if number < MOST:
                answers = (*_answers(kept[:, [at + number]]),)
                yield Sensor(At(0, 0.0, number), client, name, kind, -1, BASE, answers)
        at += len(described.names[element])
    for number, name in enumerate(described.names["sensor"][:MOST]):
        which, of = (int(np.ravel(arrays[f"sensor_{each}"])[number]) for each in ("type", "objid"))
        at, width = (int(np.ravel(arrays[f"sensor_{each}"])[number]) for each in ("adr", "dim"))
        body, link, place = -1, BASE, None
        if which < len(KINDS):
            on = int(np.ravel(arrays["site_bodyid"])[of])
            if on:
                body, link = described.link_of.get(on, (-1, BASE))
                place = _place(arrays, on, of, link)
        yield Sensor(
            At(0, 0.0, number),
            client,
            name,
            KINDS[which] if which < len(KINDS) else "",
            body,
            link,
            tuple(_answers(kept[:, at : at + width])),
            place,
        )


def _answers(kept: NDArray[np.float64]) -> Iterator[Answer]:
    names: Sequence[str] = "xyz" if kept.shape[1] == 3 else [str(k) for k in range(kept.shape[1])]
    for name, values in zip(names, kept.T.tolist(), strict=True):
        yield Answer(name, *values)


def _place(arrays: Arrays, body: int, site: int, link: int) -> Collision:
    """Return a sensor site as a shape on its link."""
    axes = xyzw(arrays["body_iquat"][body])
    arm = np.asarray(arrays["site_pos"][site], np.float64) - arrays["body_ipos"][body]
    kind = GEOMS.get(int(arrays["site_type"][site]), "")
    turn = products(axes[None] * [-1, -1, -1, 1], xyzw(arrays["site_quat"][site])[None])[0]
    return Collision(
        link,
        kind,
        size_of(kind, arrays["site_size"][site]),
        "",
        tuple(rotate_inverse(axes[None], arm[None])[0].tolist()),
        tuple(turn.tolist()),
    )

"""Describes joints of a free robot whose commanded velocities are opposite in the world."""

from __future__ import annotations

import numpy as np

from drop_physics.account.asked import SELDOM, Axis, axes_in_world, axes_of
from drop_physics.account.names import main_axis
from drop_physics.account.series import JointSeries
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.words import RowWords
from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.quantities import quantity

ALONG = 0.99
"""Cosine above which two axes count as parallel."""
AS_FAST = 0.5
"""Share of the fastest commanded velocity from which another command counts."""


def opposed(subject: MeasuredBody, series: JointSeries | None, words: RowWords) -> Message:
    """Describe wheels whose commanded velocities are opposite in the world, or nothing.

    Equal commands turn joints with opposite axes in opposite directions, and so do commands of
    opposite signs for joints with parallel axes.
    """
    if series is None or series.after.shape[1] != subject.tree.joint_rates or subject.tree.fixed:
        return Message("")
    spins: list[tuple[Axis, Float64]] = []
    for axis in axes_of(subject, words):
        rate = series.asked_rate[:, axis.joint_rate]
        known = np.isfinite(rate)
        axes = axes_in_world(subject, axis)
        if axis.joint.kind == "revolute" and known.mean() > SELDOM and axes is not None:
            spins.append((axis, float(rate[known].mean()) * axes[0]))
    if not spins:
        return Message("")
    speeds = [float(np.linalg.norm(spin)) for _, spin in spins]
    one, first = spins[int(np.argmax(speeds))]
    fastest = max(speeds)
    for (other, spin), speed in zip(spins, speeds, strict=True):
        if speed > AS_FAST * fastest > 0 and first @ spin < -ALONG * fastest * speed:
            return Message(
                "; {one} is commanded to turn with {first} about {axis}, {other} with {second} "
                "about {back}",
                one=one.name,
                first=quantity(fastest, "rad/s"),
                axis=main_axis(first),
                other=other.name,
                second=quantity(speed, "rad/s"),
                back=main_axis(spin),
            )
    return Message("")

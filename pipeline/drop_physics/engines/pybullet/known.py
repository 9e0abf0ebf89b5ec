"""PyBullet defaults that other engines do not share, with the calls that remove them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from drop_physics.engines.pybullet.logged import BODY
from drop_physics.messages import Message
from drop_physics.trace.logs import KnownDifference, LoggedCall

VELOCITY_CONTROL = 0
FAR = 1e6
"""A joint limit that is never reached [rad, m]."""


class Likeness(NamedTuple):
    """Timestep, gravity, masses and other properties of the same body in another engine."""

    timestep_s: float
    gravity_m_s2: Sequence[float]
    masses_kg: Sequence[float] | None
    """Masses of base and links [kg]; None if the links do not correspond."""
    inertias_kg_m2: Sequence[Sequence[float]] | None
    is_limited: bool
    """Whether any joint of the body has limits."""


def known_differences(
    body: int, links: int, timestep_s: float, likeness: Likeness
) -> Iterator[KnownDifference]:
    """Yield PyBullet's defaults that may make a body move differently than in another engine.

    Parameters
    ----------
    body
        The number of the body in the log.
    links
        The number of the body's links, without the base.
    timestep_s
        PyBullet's timestep [s].
    likeness
        The properties of the body and of its world in the other engine.
    """

    def call(function: str, **given: object) -> LoggedCall:
        return LoggedCall(function, given, 0, "model")

    def dynamics(link: int, **given: object) -> LoggedCall:
        return call("changeDynamics", bodyUniqueId=[BODY, body], linkIndex=link, **given)

    joints, every = range(links), range(-1, links)
    yield KnownDifference(
        Message("linearDamping and angularDamping, 0.04 by default in PyBullet"),
        calls=[dynamics(link, linearDamping=0, angularDamping=0) for link in every],
    )
    yield KnownDifference(
        Message("the velocity motor of each joint, on by default in PyBullet"),
        calls=[
            call(
                "setJointMotorControl2",
                bodyUniqueId=[BODY, body],
                jointIndex=joint,
                controlMode=VELOCITY_CONTROL,
                force=0,
            )
            for joint in joints
        ],
    )
    if likeness.inertias_kg_m2 is not None:
        yield KnownDifference(
            Message("inertia: PyBullet takes it from the shapes, not from the file"),
            calls=[
                dynamics(link, localInertiaDiagonal=[*likeness.inertias_kg_m2[link + 1]])
                for link in every
                if any(likeness.inertias_kg_m2[link + 1])
            ],
        )
    yield KnownDifference(
        Message("joint damping (jointDamping) in PyBullet"),
        calls=[dynamics(joint, jointDamping=0) for joint in joints],
    )
    if not likeness.is_limited:
        wide = {"jointLowerLimit": -FAR, "jointUpperLimit": FAR}
        yield KnownDifference(
            Message("joint limits in PyBullet"),
            calls=[dynamics(joint, **wide) for joint in joints],
        )
    if likeness.timestep_s != timestep_s:
        yield KnownDifference(
            Message("timestep"),
            is_setting=True,
            calls=[call("setTimeStep", timeStep=likeness.timestep_s)],
            value=timestep_s,
            other=likeness.timestep_s,
        )
    gravity = dict(zip(("gravX", "gravY", "gravZ"), likeness.gravity_m_s2, strict=True))
    yield KnownDifference(
        Message("gravity"), is_setting=True, calls=[call("setGravity", **gravity)]
    )
    if likeness.masses_kg is not None:
        yield KnownDifference(
            Message("mass"),
            calls=[
                dynamics(link, mass=likeness.masses_kg[link + 1])
                for link in every
                if likeness.masses_kg[link + 1]
            ],
        )

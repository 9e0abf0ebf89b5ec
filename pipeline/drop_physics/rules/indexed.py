"""Finds the bodies and joints that are meant by MuJoCo's indices."""

from __future__ import annotations

from drop_physics.rules.joint import link_of
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

BASE_M = 3
"""Index of the quaternion in the coordinates of a free base."""


def bodies_of(seen: Seen, client: int) -> list[Body]:
    """Return the bodies of a simulation in the engine's order."""
    return [body for body in seen.bodies.values() if body.client == client]


def body_at(seen: Seen, client: int, index: int) -> Body | None:
    """Return the recorded body that contains a MuJoCo body, given the latter's index."""
    before = [body for body in bodies_of(seen, client) if body.engine_id <= index]
    return max(before, key=lambda each: each.engine_id, default=None)


def rate_at(seen: Seen, client: int, index: int) -> tuple[Body, str | None, str] | None:
    """Return body, joint (None for the base) and joint type for an engine's dof index."""
    body, at = seen.freedom(client, index) or (None, 0)
    if body is None:
        return None
    base = 6 * body.base_moves
    if at < base:
        return body, None, "prismatic" if at < 3 else "revolute"
    joint = body.joints[link_of(body, at - base)]
    return body, joint.name, joint.kind


def turn_at(seen: Seen, client: int, index: int) -> Body | None:
    """Return the body whose base quaternion starts at an index of `qpos`."""
    for body in bodies_of(seen, client):
        if body.base_moves and index == BASE_M:
            return body
        index -= sum(joint.widths[0] for joint in body.joints) + (7 if body.base_moves else 0)
    return None

"""Collects the calls that load bodies and set their properties, and the sizes of bodies."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from drop_physics.explain.convex import is_convex
from drop_physics.physics.columns import rotation
from drop_physics.rules.arguments import site_of
from drop_physics.trace.acts import MAKES, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Appearance, Body, Collision, Joint
from drop_physics.trace.history import Piece, Seen


@dataclass
class AskedProperty:
    """A property that `changeDynamics` calls set, by body id."""

    values: dict[int, float] = field(default_factory=dict)
    """The largest value that a call set."""
    since: dict[int, int] = field(default_factory=dict)
    """The step after which a call first set the property."""
    sites: dict[int, str] = field(default_factory=dict)
    """File and line of the last call that set the property."""
    changed: set[int] = field(default_factory=set)
    """Bodies for which calls set different values over time."""

    def site(self, *bodies: int) -> str | None:
        """Return file and line of the call for the first of the given bodies with such a call."""
        return next((self.sites[body] for body in bodies if body in self.sites), None)


class AskedOfBodies:
    """All properties that calls set on bodies, for all rules; filled chunk by chunk."""

    def __init__(self, appearances: list[Appearance]) -> None:
        self._came = {
            appearance.body.number: appearance.at.call
            for appearance in appearances
            if appearance.came
        }
        self._loads: dict[tuple[int, int], list[Call]] = {}
        """Calls that loaded a body, by client and the engine's body id."""
        self.of: defaultdict[str, AskedProperty] = defaultdict(AskedProperty)
        """Requested values, by argument name."""

    def see(self, piece: Piece) -> None:
        """Add the calls of a chunk."""
        for call in piece.calls.of(*MAKES):
            if np.isfinite(call.result):
                self._loads.setdefault((call.client, int(call.result)), []).append(call)
        for call, _, came in piece.calls.of_bodies(Act.SET_PROPERTY):
            body = came.body
            for name, numbers in call.values.items():
                asked, value = self.of[name], float(numbers[0])
                asked.sites[body.number] = site_of(call)
                asked.since.setdefault(body.number, call.at.step)
                if value != asked.values.get(body.number, value):
                    asked.changed.add(body.number)
                asked.values[body.number] = max(asked.values.get(body.number, value), value)

    def load(self, body: Body) -> Call | None:
        """Return the call that created a body."""
        came = self._came.get(body.number, -1)
        made = self._loads.get((body.client, body.engine_id), [])
        return next((each for each in reversed(made) if each.at.call <= came), None)

    def loaded(self, body: Body) -> str | None:
        """Return file and line of the call that created a body."""
        call = self.load(body)
        return None if call is None else site_of(call)


def part_named(body: Body, link: int) -> str:
    """Return the name of a link, or the name of its body if the body has no other link."""
    single = len(body.links) < 2 or link + 1 >= len(body.links)
    return body.label if single else f"{body.label} ({body.links[link + 1]})"


def size_m(body: Body) -> float:
    """Return the longest edge of a body's bounding box as loaded [m]; 1 if unknown."""
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))
    return float(np.max(boxes[:, 1] - boxes[:, 0], initial=0.0)) or 1.0


def length_m(body: Body, joint: Joint) -> float:
    """Return the longest edge of the box around a joint's link [m]; 0 if unknown."""
    boxes, link = np.reshape(body.bounds_m, (-1, 2, 3)), body.joints.index(joint)
    return float(np.ptp(boxes[link + 1], axis=0).max()) if link + 1 < len(boxes) else 0.0


def thickness_m(body: Body, link: int) -> float:
    """Return the shortest edge of a link's shape, or of a box around its shapes [m].

    The result is inf for planes and for shapes that are not convex, which have no inside.
    """
    shapes = [collision for collision in body.collisions if collision.link == link]
    if any(shape.kind == "plane" or not is_convex(shape) for shape in shapes):
        return np.inf
    if len(shapes) == 1:
        return _thickness_m(shapes[0])
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))[link + 1 : link + 2]
    return float((boxes[:, 1] - boxes[:, 0]).min(initial=np.inf))


def _thickness_m(shape: Collision) -> float:
    size = shape.size_m
    if shape.kind == "mesh":
        axes = rotation(np.array(shape.orientation)[:, None])[..., 0]
        return float(np.ptp(np.reshape(shape.hull_m, (-1, 3)) @ axes, axis=0).min())
    if shape.kind == "cylinder":
        return min(size[0], 2 * size[1])
    return min(size) if shape.kind == "box" else 2 * size[-1]  # a ball, or a capsule


def strained_by(seen: Seen, bodies: Collection[Body]) -> float:
    """Return the mass ratio of bodies in contact if it is too large for the solver, else 0.

    The result is also 0 if the solver stops before its last iteration, and for bodies with joints,
    whose masses act together.
    """
    numbers = {body.number for body in bodies}
    told = {
        each.body.number: float(each.reported["mass_kg"][0])
        for each in seen.dynamics
        if each.body.number in numbers
    }
    masses_kg = [each for each in told.values() if each > 0]
    plain = masses_kg and all(len(body.links) == 1 for body in bodies)
    clients = {solver.client for solver in seen.solvers if solver.steps}
    early = all(body.client in clients for body in bodies)
    return max(masses_kg) / min(masses_kg) if plain and early else 0.0

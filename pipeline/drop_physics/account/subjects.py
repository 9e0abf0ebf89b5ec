"""Sizes and weights to which rows are compared, and a key for bodies that are alike."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from drop_physics.account.ledger import Ledger
from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE, Tree
from drop_physics.quantities import number
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

UNBOUNDED = ("plane", "hfield", "heightfield")
"""Kinds of shapes without a size."""
STANDARD_GRAVITY_M_S2 = 9.81
"""Gravity for comparisons of weights in a scene without gravity."""
LEAST_M = 0.1
"""The size assumed for a body without a shape."""


@dataclass(frozen=True, eq=False)
class MeasuredBody:
    """A body with its size, weight and other scales that rows are compared with."""

    body: Body
    ledger: Ledger
    size_m: float
    """The longest edge of its largest part, or the reach of its joints if that is larger."""
    mass_kg: float
    """The mass of the movable links."""
    weight_n: float
    """The weight of those links; in a scene without gravity, at standard gravity."""
    is_weightless: bool

    def lasts(self, seen: Seen) -> bool:
        """Return whether the steps seen here reach the end of the run."""
        return self.ledger.last >= seen.steps_of(self.body.client)

    @property
    def kind(self) -> Hashable:
        """A key that is equal for bodies that are alike."""
        return len(self.body.links), round(self.mass_kg, 9), round(self.size_m, 9)

    @property
    def pull_m_s2(self) -> float:
        """Gravity as it acts on the body [m/s²]; 0 without."""
        return 0.0 if self.is_weightless else self.weight_n / (self.mass_kg or np.inf)

    @property
    def tree(self) -> Tree:
        """The body as a tree of links."""
        return self.ledger.tree


def subject_of(body: Body, ledger: Ledger, gravity_m_s2: Float64) -> MeasuredBody:
    """Measure a body; `gravity_m_s2` has the shape (3,)."""
    tree = ledger.tree
    mass_kg = float(tree.masses_kg[_movable(body)].sum())
    pull = float(np.linalg.norm(gravity_m_s2))
    weight_n = max(mass_kg * (pull or STANDARD_GRAVITY_M_S2), 1e-9)
    return MeasuredBody(body, ledger, _size_m(body, tree), mass_kg, weight_n, not pull)


def _movable(body: Body) -> list[int]:
    """Return the rows of the links that can move, in tables of base and links."""
    return [link + 1 for link in body.moving]


def in_weights(force_n: float, subject: MeasuredBody, name: str) -> Message:
    """Describe a force as a multiple of the weight of a body of this name.

    A body of several moving links, the first of which may have its name, is told by its label.
    """
    times = number(force_n / subject.weight_n)
    if np.count_nonzero(subject.tree.masses_kg[_movable(subject.body)]) > 1:
        name = Message("all that moves of {body}", body=subject.body.label)
    if subject.is_weightless:
        return Message("{times} times what {body} would weigh on Earth", times=times, body=name)
    return Message("{times} times the weight of {body}", times=times, body=name)


def turning_rad_s(subject: MeasuredBody, *, before: bool = False) -> Float64:
    """Return a floating base's mean angular velocity in the last tenth of its steps, shape (3,).

    With `before`, it is that in the preceding tenth.
    """
    ledger = subject.ledger
    known = np.flatnonzero(ledger.counts)
    tenth = max(1, len(known) // 10)
    late = known[-2 * tenth : -tenth] if before else known[-tenth:]
    seconds = float(ledger.seconds[late].sum())
    if subject.tree.fixed or not seconds:
        return np.zeros(3)
    return np.asarray(ledger.way[late, :3].sum(axis=0) / seconds)


def _size_m(body: Body, tree: Tree) -> float:
    shapes = [(collision.kind, collision.size_m) for collision in body.collisions]
    shapes += [(shape.kind, shape.size_m) for shape in body.shapes]
    # The size of a mesh is its scale: the box around it tells how large it is.
    sizes = [max(size_m) for kind, size_m in shapes if size_m and kind not in (*UNBOUNDED, "mesh")]
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))
    box = float(np.max(boxes[:, 1] - boxes[:, 0], initial=0.0))
    # The way from a fixed base to its first joints says nothing of the size of the moving links.
    within = np.array([not tree.fixed or parent != BASE for parent in tree.parents], np.bool_)
    reach = float(np.abs(tree.positions_m[within]).sum())
    return max([*sizes, box if box < 1e3 else 0.0, reach]) or LEAST_M

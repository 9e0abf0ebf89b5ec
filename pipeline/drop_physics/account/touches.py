"""The table of contacts: which bodies touched, with which force, slip and overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import PRESSED, LinkPairs, Pairs
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.physics.vectors import lengths, triple
from drop_physics.trace.history import Seen

WHOLE = ("gravity", "damping", "applied", "constraints", "contacts")
"""The terms that act on a whole tree from outside."""
LIMIT = 0.98
"""Share of its limit above which friction counts as at its limit."""
RUBS = 1e-6
"""Share of the normal force above which a friction force acts."""
MOST_PAIRS = 1 << 12
"""Maximum number of link pairs that are kept apart."""

PairKey = tuple[int, int, int, int]
"""Ids of two bodies, and their links."""


@dataclass(frozen=True, kw_only=True)
class Touch:
    """A contact between two bodies, as seen from one of them."""

    other: str
    """Label of the other body, in JSON `with`."""
    steps: int
    """Number of steps in which a force acted."""
    friction: float | None
    """Friction coefficient: the product of both, in MuJoCo the larger; None if several parts with
    different coefficients touched."""
    used: float | None
    """Largest ratio of the pair's friction to the possible friction Σ μN."""
    available_n: float | None
    """Maximum possible friction Σ μN at the step that requires most friction."""
    needed_n: float | None
    """Friction required to balance all other forces on the body."""
    friction_needed: float | None
    """Smallest sufficient friction coefficient; None if the normals are not parallel."""
    slid_m: float
    """Tangential distance while touching: the mean of the points with a force."""
    deepest_m: float
    """The largest overlap."""
    impulse_n_s: tuple[float, float, float] | None
    """Impulse given to this body, world axes; None where `numSubSteps` hides a part of it."""
    energy_j: float | None
    """Energy given to this body; None where `numSubSteps` hides a part of it."""
    energy_of_pair_j: float | None
    """Energy given to both bodies; None where `numSubSteps` hides a part of it."""


@dataclass(frozen=True, eq=False)
class _PairSums:
    """Contact quantities of each pair, summed over a chunk; arrays have the shape (pairs,)."""

    first_step: Int64
    last_step: Int64
    steps: Int64
    """Number of steps in which a normal force acts."""
    pressed_step: Int64
    """The last step in which a normal force acts."""
    lowest: Float64
    """The lowest friction coefficient of a contact point with a force."""
    highest: Float64
    used: Float64
    """Largest ratio of friction to the possible friction Σ μN; negative if none is possible."""
    at_limit: Int64
    """Number of steps in which the friction of all points together is at its limit."""
    rubs: Flags
    slid_m: Float64
    deepest_m: Float64
    deepest_step: Int64

    @staticmethod
    def of(pairs: Pairs) -> _PairSums:
        """Return the sums of each pair."""
        grouped, points, acts = pairs.grouped, pairs.points, pairs.acts
        pressed, friction = points.normal_n > PRESSED, points.friction
        available = np.where(acts & (pairs.available_n > PRESSED), pairs.available_n, np.nan)
        shares = np.where(np.isnan(available), -1.0, lengths(pairs.tangential_n) / available)
        at_limit = acts & (pairs.rubbed_n >= LIMIT * pairs.available_n)
        rubbing_n = grouped.most(pairs.most(lengths(points.tangential_n)))
        pressing_n = grouped.most(pairs.most(points.normal_n))
        deepest = grouped.first_of_most(pairs.depth_m)
        return _PairSums(
            first_step=pairs.step[grouped.firsts],
            last_step=pairs.step[grouped.lasts],
            steps=grouped.summed(acts.astype(np.int64)),
            pressed_step=grouped.most(np.where(acts, pairs.step, -1.0)).astype(np.int64),
            lowest=-grouped.most(pairs.most(np.where(pressed, -friction, -np.inf))),
            highest=grouped.most(pairs.most(np.where(pressed, friction, -np.inf))),
            used=grouped.most(shares),
            at_limit=grouped.summed(at_limit.astype(np.int64)),
            rubs=rubbing_n > RUBS * pressing_n,
            slid_m=grouped.summed(np.where(acts, pairs.slip_m_s * pairs.timestep_s, 0.0)),
            deepest_m=pairs.depth_m[deepest],
            deepest_step=pairs.step[deepest],
        )


@dataclass(eq=False)
class Touched:
    """Totals of two links, or two bodies, that touched; filled chunk by chunk."""

    first_step: int
    """The sample after the first step with a contact point."""
    last_step: int = -1
    steps: int = 0
    """Number of steps in which a normal force acts."""
    pressed_step: int = -1
    """The last step in which a normal force acts."""
    coefficients: tuple[float, float] = (np.inf, -np.inf)
    """The lowest and the highest friction coefficient where a force acts."""
    used: float = -1.0
    """Largest ratio of friction to the possible friction Σ μN; negative if none is possible."""
    at_limit: int = 0
    """Number of steps in which the friction of all points together is at its limit."""
    rubs: bool = False
    """Whether any friction acted."""
    slid_m: float = 0.0
    deepest_m: float = 0.0
    deepest_step: int = -1

    @property
    def friction(self) -> float:
        """The highest friction coefficient; 0 if unknown."""
        return max(self.coefficients[1], 0.0)

    def add(self, sums: _PairSums, row: int) -> None:
        """Add a chunk's sums, found at the given row."""
        low, high = self.coefficients
        self.coefficients = min(low, float(sums.lowest[row])), max(high, float(sums.highest[row]))
        self.last_step = int(sums.last_step[row])
        self.steps += int(sums.steps[row])
        self.pressed_step = max(self.pressed_step, int(sums.pressed_step[row]))
        self.used = max(self.used, float(sums.used[row]))
        self.at_limit += int(sums.at_limit[row])
        self.rubs |= bool(sums.rubs[row])
        self.slid_m += float(sums.slid_m[row])
        if sums.deepest_m[row] > self.deepest_m:
            self.deepest_m = float(sums.deepest_m[row])
            self.deepest_step = int(sums.deepest_step[row])


@dataclass(eq=False)
class TouchedLinks(Touched):
    """Two links that touched."""

    normals_n: list[Float64] = field(default_factory=list)
    """The normal force in each step in which one acts [N], by chunk."""

    @property
    def normal_n(self) -> float:
        """The median normal force over the steps in which one acts [N]."""
        return float(np.median(np.concatenate(self.normals_n))) if self.steps else 0.0


@dataclass(frozen=True)
class _Need:
    """The step in which a pair needs the most friction to hold one body."""

    needed_n: float
    available_n: float
    normal_n: float


@dataclass(eq=False)
class _TouchedBodies(Touched):
    """Two bodies that touched, or two links of one."""

    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    """Impulse on the body with the lower id, world axes [N s], shape (3,)."""
    energy_j: Float64 = field(default_factory=lambda: np.zeros(2))
    """Energy given to each body [J], shape (2,)."""
    needs: list[_Need | None] = field(default_factory=lambda: [None, None])
    """The step that requires most friction, for each body; None if unknown."""
    whole: bool = True
    """Whether the forces of all steps are known; False if some are only those of a last substep."""

    def need(self, side: int, need: _Need) -> None:
        """Keep the step that needs the most friction of all steps so far."""
        most = self.needs[side]
        if most is None or _digits(need.needed_n) >= _digits(most.needed_n):
            self.needs[side] = need

    def touch(self, other: str, side: int, *, itself: bool) -> Touch:
        """Return the table row for one of the two bodies; `other` is the other's label."""
        low, high = self.coefficients
        need, sign = self.needs[side], -1.0 if side else 1.0
        energy_j = float(self.energy_j.sum() if itself else self.energy_j[side])
        return Touch(
            other=other,
            steps=self.steps,
            friction=low if low == high else None,
            used=self.used if self.used >= 0 else None,
            available_n=None if need is None else need.available_n,
            needed_n=None if need is None else need.needed_n,
            friction_needed=None if need is None else need.needed_n / need.normal_n,
            slid_m=self.slid_m,
            deepest_m=self.deepest_m,
            impulse_n_s=triple(sign * self.impulse_n_s) if self.whole else None,
            energy_j=energy_j if self.whole else None,
            energy_of_pair_j=float(self.energy_j.sum()) if self.whole else None,
        )


class TouchTable:
    """The pairs that touched in a recording or an episode, filled chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self.links: dict[PairKey, TouchedLinks] = {}
        """Pairs of links."""
        self._bodies: dict[tuple[int, int], _TouchedBodies] = {}
        """Pairs of bodies, the lower id first."""

    def add(self, explained: ExplainedPiece, pairs: Pairs) -> None:
        """Add the contact points of a chunk."""
        if not len(pairs.starts):
            return
        self._add_links(pairs.by_link)
        grouped, sums = pairs.grouped, _PairSums.of(pairs)
        impulse_n_s = grouped.summed(pairs.force_n * pairs.timestep_s[:, None])
        energy_j = grouped.summed(pairs.energy_j)
        hidden = grouped.most(_hidden(explained, pairs).astype(np.float64))
        needs = [_Needs.of(explained, pairs, side) for side in (0, 1)]
        for row, (one, other) in enumerate(pairs.body[grouped.firsts].tolist()):
            key = one, other
            touched = self._bodies.get(key)
            if touched is None:
                touched = self._bodies[key] = _TouchedBodies(int(sums.first_step[row]))
            touched.add(sums, row)
            touched.impulse_n_s = touched.impulse_n_s + impulse_n_s[row]
            touched.energy_j = touched.energy_j + energy_j[row]
            touched.whole &= not hidden[row]
            for side, number in enumerate(key):
                need = needs[side].at(row)
                if need is not None and number in explained.bodies and one != other:
                    touched.need(side, need)

    def _add_links(self, pairs: LinkPairs) -> None:
        grouped, sums = pairs.grouped, _PairSums.of(pairs)
        keys = np.concatenate((pairs.body, pairs.link), axis=1)[grouped.firsts].tolist()
        for row, ((a, b, i, j), its) in enumerate(zip(keys, grouped.rows(), strict=True)):
            key: PairKey = (a, b, i, j)
            if key not in self.links and len(self.links) >= MOST_PAIRS:
                continue
            touched = self.links.get(key)
            if touched is None:
                touched = self.links[key] = TouchedLinks(int(sums.first_step[row]))
            touched.add(sums, row)
            touched.normals_n.append(pairs.normal_n[its[pairs.acts[its]]])

    def rows(self, body: int) -> Sequence[Touch]:
        """Return the contacts of a body, by its id."""
        found = {}
        for key, touched in self._bodies.items():
            if body in key and touched.steps:
                side = key.index(body)
                other = key[1 - side]
                label = self._seen.bodies[other].label
                found[other] = touched.touch(label, side, itself=key[0] == key[1])
        return [found[other] for other in sorted(found)]


def _hidden(explained: ExplainedPiece, pairs: Pairs) -> Flags:
    """Flag the pairs whose forces are only known for the last substep, shape (m,)."""
    hidden = np.zeros(len(pairs.starts), np.bool_)
    if any(batch.whole.substeps > 1 for batch, _ in explained.batches):
        for side in (0, 1):
            for batch, _, its, at in explained.steps_at(pairs.body[:, side], pairs.step):
                hidden[its] |= (batch.whole.substeps > 1) & ~batch.whole.closes[at]
    return hidden


@dataclass(frozen=True, eq=False)
class _Needs:
    """The steps that need the most friction, for each pair of bodies.

    Arrays have the shape (pairs,).
    """

    needed_n: Float64
    """Friction required [N]; negative if unknown."""
    available_n: Float64
    normal_n: Float64

    def at(self, row: int) -> _Need | None:
        """Return a pair's step that needs the most friction; None if unknown."""
        needed_n = float(self.needed_n[row])
        if needed_n < 0:
            return None
        return _Need(needed_n, float(self.available_n[row]), float(self.normal_n[row]))

    @staticmethod
    def of(explained: ExplainedPiece, pairs: Pairs, side: int) -> _Needs:
        """Find each pair's step that needs the most friction to hold the body on one side."""
        needed = np.full(len(pairs.starts), -1.0)
        known = pairs.one_line & pairs.explained[:, side] & (pairs.normal_n > PRESSED)
        rows, sign = np.flatnonzero(known), -1.0 if side else 1.0
        for batch, _, found, at in explained.steps_at(pairs.body[rows, side], pairs.step[rows]):
            steps, its = batch.whole, rows[found]
            if steps.law.tree.fixed or not steps.terms:
                continue
            outside = sum(steps.terms[name][at, 3:6] for name in WHOLE)
            others = outside / pairs.timestep_s[its, None] - sign * pairs.force_n[its]
            line = pairs.line[its]
            needed[its] = lengths(others - np.einsum("mi,mi->m", others, line)[:, None] * line)
        # Of those that need as much, to three digits, the last: a load settles.
        digits = np.where(needed >= 0, _digits(needed), -np.inf)
        most = pairs.grouped.last_of_most(digits)
        return _Needs(needed[most], pairs.available_n[most], pairs.normal_n[most])


def _digits(value: float | Float64) -> Float64:
    """Round a number to three significant digits."""
    return np.floor(1e3 * np.log(np.maximum(value, PRESSED)))

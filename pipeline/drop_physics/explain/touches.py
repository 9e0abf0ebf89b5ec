"""Pairs of bodies that touched: friction used and required, sliding distance, energy, impulse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.contact_points import Pairs, pairs_of
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.physics.vectors import lengths, triple
from drop_physics.trace.history import Seen

WHOLE = ("gravity", "damping", "applied", "constraints", "contacts")
"""The terms that act on a whole tree from outside."""
PRESSED = 1e-9
"""A force below this value counts as zero [N]."""


@dataclass(frozen=True, kw_only=True)
class Touch:
    """A body's contact with another body."""

    other: str
    """Label of the other body, in JSON `with`."""
    steps: int
    """Number of steps in which a force acted."""
    friction: float | None
    """Friction coefficient: the product of both, in MuJoCo the larger; None if several parts with
    different coefficients touched."""
    used: float | None
    """Largest share of Σ μN that the pair used."""
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


@dataclass
class _Total:
    """Totals of one pair, seen from one of its bodies; grows chunk by chunk."""

    steps: int = 0
    coefficients: tuple[float, float] = (np.inf, -np.inf)
    """The lowest and the highest friction coefficient."""
    used: float = -1.0
    needed_n: float = -1.0
    """Friction required at the step that requires most."""
    available_n: float = 0.0
    normal_n: float = 0.0
    slid_m: float = 0.0
    deepest_m: float = 0.0
    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    energy_j: float = 0.0
    energy_of_pair_j: float = 0.0
    whole: bool = True
    """Whether the forces of all steps are known; False if some are only those of a last substep."""

    def add(self, numbers: Mapping[str, Float64], row: int, side: int, *, itself: bool) -> None:
        """Add the totals of the pair in a chunk (`_numbers`)."""
        now = {name: number[row] for name, number in numbers.items()}
        low, high = self.coefficients
        self.steps += int(now["steps"])
        self.coefficients = min(low, float(now["lowest"])), max(high, float(now["highest"]))
        self.used = max(self.used, float(now["used"]))
        self.slid_m += float(now["slid_m"])
        self.deepest_m = max(self.deepest_m, float(now["deepest_m"]))
        self.impulse_n_s = self.impulse_n_s + (-1.0 if side else 1.0) * now["impulse_n_s"]
        given, of_pair_j = now["energy_j"], float(now["energy_j"].sum())
        self.energy_j += of_pair_j if itself else float(given[side])
        self.energy_of_pair_j += of_pair_j
        self.whole &= not now["hidden"]

    def need(self, needs: _Needs, row: int) -> None:
        """Update the step that requires most friction, if a step of this chunk requires more."""
        needed_n = float(needs.needed_n[row])
        if needed_n >= 0 and _digits(needed_n) >= _digits(self.needed_n):
            self.needed_n = needed_n
            self.available_n = float(needs.available_n[row])
            self.normal_n = float(needs.normal_n[row])


class TouchTable:
    """The table of touching pairs; grows chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._totals: dict[int, dict[int, _Total]] = {}
        """Totals, by body id and the other body's id."""
        self.pairs: Pairs
        """The contact points of the latest chunk, until `forget`."""

    def forget(self) -> None:
        """Free the latest chunk."""
        del self.pairs

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk."""
        pairs = self.pairs = pairs_of(explained)
        if not len(pairs.starts):
            return
        grouped = pairs.grouped
        numbers = _numbers(pairs, _hidden(explained, pairs))
        first, second = pairs.body[grouped.firsts].T.tolist()
        needs = [_Needs.of(explained, pairs, side) for side in (0, 1)]
        for row, (one, other) in enumerate(zip(first, second, strict=True)):
            for side, number in enumerate(dict.fromkeys((one, other))):
                its = self._totals.setdefault(number, {})
                total = its.setdefault(other if side == 0 else one, _Total())
                total.add(numbers, row, side, itself=one == other)
                if number in explained.bodies and one != other:
                    total.need(needs[side], row)

    def rows(self, body: int) -> Sequence[Touch]:
        """Return the touching pairs of a body, by body id."""
        its = self._totals.get(body, {})
        return [self._touch(other, its[other]) for other in sorted(its) if its[other].steps]

    def _touch(self, other: int, total: _Total) -> Touch:
        low, high = total.coefficients
        needs = total.needed_n >= 0
        whole = total.whole
        return Touch(
            other=self._seen.bodies[other].label,
            steps=total.steps,
            friction=low if low == high else None,
            used=total.used if total.used >= 0 else None,
            available_n=total.available_n if needs else None,
            needed_n=total.needed_n if needs else None,
            friction_needed=total.needed_n / total.normal_n if needs else None,
            slid_m=total.slid_m,
            deepest_m=total.deepest_m,
            impulse_n_s=triple(total.impulse_n_s) if whole else None,
            energy_j=total.energy_j if whole else None,
            energy_of_pair_j=total.energy_of_pair_j if whole else None,
        )


def _hidden(explained: ExplainedPiece, pairs: Pairs) -> Flags:
    """Flag the pairs for which only the forces of a last substep are known, shape (m,)."""
    hidden = np.zeros(len(pairs.starts), np.bool_)
    if any(batch.whole.substeps > 1 for batch, _ in explained.batches):
        for side in (0, 1):
            for batch, _, its, at in explained.steps_at(pairs.body[:, side], pairs.step):
                hidden[its] |= (batch.whole.substeps > 1) & ~batch.whole.closes[at]
    return hidden


def _numbers(pairs: Pairs, hidden: Flags) -> dict[str, Float64]:
    """Return the totals of each pair in a chunk, shape (pairs, …)."""
    grouped, dt = pairs.grouped, pairs.timestep_s
    pressed, friction = pairs.points.normal_n > PRESSED, pairs.points.friction
    acts = pairs.normal_n > PRESSED
    available = np.where(acts & (pairs.available_n > PRESSED), pairs.available_n, np.nan)
    shares = np.where(np.isnan(available), -1.0, lengths(pairs.tangential_n) / available)
    return {
        "steps": grouped.summed(acts.astype(np.float64)),
        "lowest": -grouped.most(pairs.most(np.where(pressed, -friction, -np.inf))),
        "highest": grouped.most(pairs.most(np.where(pressed, friction, -np.inf))),
        "used": grouped.most(shares),
        "slid_m": grouped.summed(np.where(acts, pairs.slip_m_s * dt, 0.0)),
        "deepest_m": grouped.most(pairs.depth_m),
        "impulse_n_s": grouped.summed(pairs.force_n * dt[:, None]),
        "energy_j": grouped.summed(pairs.energy_j),
        "hidden": grouped.most(hidden.astype(np.float64)),
    }


@dataclass(frozen=True, eq=False)
class _Needs:
    """The step of each pair that requires most friction to balance all other forces on one side.

    Arrays have the shape (pairs,).
    """

    needed_n: Float64
    """Friction required; negative if unknown."""
    available_n: Float64
    normal_n: Float64

    @staticmethod
    def of(explained: ExplainedPiece, pairs: Pairs, side: int) -> _Needs:
        """Return the steps that require most friction, for the bodies on one side of each pair."""
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
    """Return a number that is equal for values that agree to three digits."""
    return np.floor(1e3 * np.log(np.maximum(value, PRESSED)))

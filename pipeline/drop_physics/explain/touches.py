"""Which pairs of bodies touched: friction used and needed, what slid, what it gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import Pairs, pairs_of
from drop_physics.explain.recording import Explained
from drop_physics.explain.step_status import Judged
from drop_physics.trace.history import Seen

Float64 = NDArray[np.float64]

WHOLE = ("gravity", "damping", "applied", "constraints", "contacts")
"""The forces on a whole tree, from outside."""
PRESSED = 1e-9
"""A force below this is none [N]."""


@dataclass(frozen=True, kw_only=True)
class Touch:
    """What happened between a body and another that it touched."""

    other: str
    """Label of the other body, in JSON `with`."""
    steps: int
    """In how many steps a force acted."""
    friction: float | None
    """Coefficient: the product of both; None where several parts with different ones touched."""
    used: float | None
    """Largest share of Σ μN that the pair used."""
    available_n: float | None
    """Σ μN at the step that needs most."""
    needed_n: float | None
    """What friction would have to be to balance all other forces on the body."""
    friction_needed: float | None
    """Coefficient that would be enough; None where the normals share no line."""
    slid_m: float
    """Tangential distance while touching, the mean of the points with a force."""
    deepest_m: float
    """The largest overlap."""
    impulse_n_s: tuple[float, float, float] | None
    """Given to this body, world axes; None where `numSubSteps` hides a part of it."""
    energy_j: float | None
    """Given to this body; likewise."""
    energy_of_pair_j: float | None
    """Given to both; likewise."""


@dataclass
class _Total:
    """One pair, seen from one of its bodies; grows piece by piece."""

    steps: int = 0
    coefficients: tuple[float, float] = (np.inf, -np.inf)
    """The lowest and the highest."""
    used: float = -1.0
    needed_n: float = -1.0
    """At the step that needs most."""
    available_n: float = 0.0
    normal_n: float = 0.0
    slid_m: float = 0.0
    deepest_m: float = 0.0
    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    energy_j: float = 0.0
    energy_of_pair_j: float = 0.0
    whole: bool = True
    """Whether the forces of all steps are known, not only those of a last substep."""


class TouchTable:
    """Grows piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._totals: dict[tuple[int, int], _Total] = {}
        """By the numbers of a body and of the other."""
        self.pairs: Pairs
        """The contact points of the latest piece, until that is forgotten."""

    def forget(self) -> None:
        """Free the latest piece."""
        del self.pairs

    def add(self, explained: Explained) -> None:
        """Take a piece."""
        pairs = self.pairs = pairs_of(explained)
        pressed, friction = pairs.points.normal_n > PRESSED, pairs.points.friction
        least = -pairs.most(np.where(pressed, -friction, -np.inf))
        greatest = pairs.most(np.where(pressed, friction, -np.inf))
        partial = {number: _partial(judged) for number, judged in explained.bodies.items()}
        for first, second, rows in pairs.by_pair():
            for side, number in enumerate(dict.fromkeys((first, second))):
                total = self._totals.setdefault((number, second if side == 0 else first), _Total())
                _count(total, pairs, rows, side)
                for one in {first, second} & partial.keys():
                    total.whole &= not np.isin(pairs.step[rows], partial[one]).any()
                low, high = total.coefficients
                total.coefficients = (
                    float(least[rows].min(initial=low)),
                    float(greatest[rows].max(initial=high)),
                )
                if number in explained.bodies and first != second:
                    _needs(total, pairs, rows, side, explained.bodies[number])

    def rows(self, body: int) -> Sequence[Touch]:
        """Return the pairs of a body, by its number."""
        return [
            self._touch(other, total)
            for (number, other), total in sorted(self._totals.items())
            if number == body and total.steps
        ]

    def _touch(self, other: int, total: _Total) -> Touch:
        low, high = total.coefficients
        needs = total.needed_n >= 0
        x, y, z = total.impulse_n_s.tolist()
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
            impulse_n_s=(x, y, z) if whole else None,
            energy_j=total.energy_j if whole else None,
            energy_of_pair_j=total.energy_of_pair_j if whole else None,
        )


def _partial(judged: Judged) -> NDArray[np.int64]:
    """Return the steps of several substeps of which only the last one's forces are known."""
    several = [each.steps[~each.closes] for each in judged.stretches if each.substeps > 1]
    return np.concatenate([np.empty(0, np.int64), *several])


def _count(total: _Total, pairs: Pairs, rows: NDArray[np.intp], side: int) -> None:
    """Add what the forces of one pair are, in some steps."""
    acts = rows[pairs.normal_n[rows] > PRESSED]
    total.steps += len(acts)
    total.deepest_m = max(total.deepest_m, float(pairs.depth_m[rows].max(initial=0.0)))
    sign, dt = (-1.0 if side else 1.0), pairs.timestep_s
    total.slid_m += float((pairs.slip_m_s[acts] * dt[acts]).sum())
    total.impulse_n_s = total.impulse_n_s + sign * (pairs.force_n[rows].T @ dt[rows])
    itself = pairs.body[rows[0], 0] == pairs.body[rows[0], 1]
    given = pairs.energy_j[rows].sum(axis=0)
    total.energy_j += float(given.sum() if itself else given[side])
    total.energy_of_pair_j += float(given.sum())
    acts = acts[pairs.available_n[acts] > PRESSED]
    shares = np.linalg.norm(pairs.tangential_n[acts], axis=1) / pairs.available_n[acts]
    total.used = max(total.used, float(shares.max(initial=-1.0)))


def _needs(total: _Total, pairs: Pairs, rows: NDArray[np.intp], side: int, judged: Judged) -> None:
    """Note the step in which friction would have to be largest to balance all other forces."""
    known = pairs.one_line[rows] & pairs.explained[rows, side] & (pairs.normal_n[rows] > PRESSED)
    sign = -1.0 if side else 1.0
    for steps in judged.stretches:
        if steps.law.tree.fixed or not steps.terms:
            continue
        its = rows[known & np.isin(pairs.step[rows], steps.steps)]
        if not len(its):
            continue
        at = np.searchsorted(steps.steps, pairs.step[its])
        outside = sum(steps.terms[name][at, 3:6] for name in WHOLE) / pairs.timestep_s[its, None]
        others = np.asarray(outside) - sign * pairs.force_n[its]
        line = pairs.line[its]
        across = others - np.einsum("mi,mi->m", others, line)[:, None] * line
        needed = np.linalg.norm(across, axis=1)
        # Of those that need as much, to three digits, the last: a load settles.
        most = int(np.lexsort((its, _digits(needed)))[-1])
        if _digits(needed[most]) >= _digits(total.needed_n):
            total.needed_n = float(needed[most])
            total.available_n = float(pairs.available_n[its[most]])
            total.normal_n = float(pairs.normal_n[its[most]])


def _digits(value: float | Float64) -> Float64:
    """Return what is equal for numbers that agree to three digits."""
    return np.floor(1e3 * np.log(np.maximum(value, PRESSED)))

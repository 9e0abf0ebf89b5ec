"""Finds the impulse term in which two runs first differ.

From a common state on, a position is the sum of its velocity's displacements and the steps' own
additions; and the velocity is the sum of the terms' contributions, M^-1 P. So the distance between
two runs is, without a remainder, a sum over the terms: the difference of a term's contribution,
times the time since.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.experiments.run_distance import Apart, Track, joints_of
from drop_physics.explain.recording import Explanation
from drop_physics.explain.replayed import Replayed
from drop_physics.explain.steps import Steps
from drop_physics.explain.times import StepTimes
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.rotations import same_way
from drop_physics.physics.tree import States, Tree
from drop_physics.trace.events import Body
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET
from drop_physics.trace.history import Seen

INTEGRATOR, SET = "integrator", "set"
"""Causes besides the terms of the sum: the position update of a step beyond velocity times
timestep, and the script's calls that set a state."""
CLEARLY = 0.5
"""Least share of all terms' effect that the first term must have to be named."""
LEAST, MOST = 256, 4096
"""Least and most steps that are explained in one pass."""


@dataclass
class _Way:
    """The motion of one coordinate since a call last set its value, term by term."""

    began: int = -1
    """The script's last step before that call, counted in script steps."""
    start: tuple[Float64, Float64] | None = None
    """Position and velocity with which the next step begins."""
    end: Float64 | None = None
    given: dict[str, Float64] = field(default_factory=dict)
    """Displacement due to each term: the velocity that the term's impulse gave, times the time
    since then."""
    known: bool = True


class _TermPart:
    """The columns of a body's state that belong to one position."""

    def __init__(self, body: Body, joint: str | None, unit: str) -> None:
        self._joint, self._unit = joint, unit
        self._at = next(
            ((at, rate) for name, _, at, rate in joints_of(body) if name == joint), None
        )

    def rates(self, tree: Tree) -> slice:
        if self._at is None:
            return slice(3, 6) if self._unit == "m" else slice(0, 3)
        rate = self._at[1]
        return slice(tree.first_rate + rate.start, tree.first_rate + rate.stop)

    def position(self, states: States, row: int) -> Float64:
        if self._at is not None:
            return np.asarray(states.joints[row, self._at[0]])
        return np.asarray((states.position_m if self._unit == "m" else states.orientation)[row])


def first_term(base: Seen, other: Seen, found: Apart, *, finer: int = 1) -> str | None:
    """Return the term with the largest share in the first difference of two runs.

    None if they do not differ, if earlier steps are not explained, or if no single term has a clear
    share.
    """
    track = found.first
    if track is None or track.from_step is None:
        return None
    end, times = track.from_step, StepTimes(base, base.bodies[track.number].client)
    ways = (
        _way(base, track.number, track, end, times, finer=1),
        _way(other, track.other, track, end, times, finer=finer),
    )
    done = _shares(*ways, times, end)
    if not done:
        return None
    largest = max(done, key=lambda name: done[name])
    return largest if done[largest] >= CLEARLY * sum(done.values()) else None


def _way(seen: Seen, number: int, track: Track, end: int, times: StepTimes, *, finer: int) -> _Way:
    """Return the displacement of a body due to each term, up to a given step of the script."""
    part, way = _TermPart(seen.bodies[number], track.joint, track.unit), _Way()
    whole = Explanation(seen) if seen.engine == PYBULLET else Replayed(seen)
    for explained in whole.pieces(min(MOST, max(LEAST, end + 2))):
        judged = explained.bodies.get(number)
        if judged is not None:
            known = judged.steps[~judged.explained]
            for steps in judged.intervals:
                _follow(way, steps, part, end, times, finer, known)
        if explained.piece.end > end * finer:
            break
    return way


def _follow(
    way: _Way, steps: Steps, part: _TermPart, end: int, times: StepTimes, finer: int, unknown: Int64
) -> None:
    """Add the contributions of several steps to a position."""
    mine = -(-steps.steps // finer)  # the script's own step that each belongs to
    rows = np.flatnonzero(mine <= end)
    if not len(rows):
        return
    put = np.flatnonzero(steps.put[rows])
    if len(put) or way.start is None:
        begin = int(rows[put[-1]]) if len(put) else int(rows[0])
        rows = rows[rows >= begin]
        at = part.rates(steps.law.tree)
        way.start = part.position(steps.before, begin), steps.before.velocity[begin, at]
        way.began, way.given, way.known = int(mine[begin]) - 1, {}, True
    way.end = part.position(steps.after, int(rows[-1]))
    if not steps.terms or np.isin(steps.steps[rows], unknown).any():
        way.known = False
        return
    tree = steps.law.tree
    matrices = mass_matrix(kinematics(tree, steps.before.at(rows)))
    impulses = np.stack([term[rows] for term in steps.terms.values()], axis=2)
    gained = np.linalg.solve(matrices, impulses)[:, part.rates(tree), :]
    left_s = times.of_all(np.array([end]))[0] - times.of_all(mine[rows] - 1)
    for name, each in zip(steps.terms, np.einsum("n,nik->ki", left_s, gained), strict=True):
        way.given[name] = way.given.get(name, np.zeros_like(each)) + each


def _shares(mine: _Way, theirs: _Way, times: StepTimes, end: int) -> Mapping[str, float]:
    """Return how much of the distance between two runs each term causes."""
    if mine.start is None or theirs.start is None or mine.end is None or theirs.end is None:
        return {}
    if mine.began != theirs.began:
        return {SET: 1.0}
    if not (mine.known and theirs.known):
        return {}
    names = {**mine.given, **theirs.given}
    none = np.zeros_like(mine.start[1])
    off = {name: theirs.given.get(name, none) - mine.given.get(name, none) for name in names}
    ends = times.of_all(np.array([mine.began, end]))
    off[SET] = _between(mine.start[0], theirs.start[0]) + (ends[1] - ends[0]) * (
        theirs.start[1] - mine.start[1]
    )
    off.pop(INTEGRATOR, None)  # what an engine's own sum has of it is in what is left, too
    off[INTEGRATOR] = _between(mine.end, theirs.end) - sum(off.values())
    return {name: float(np.linalg.norm(each)) for name, each in off.items()}


def _between(mine: Float64, theirs: Float64) -> Float64:
    """Return a difference of positions; for quaternions, a rotation vector in world axes [rad]."""
    if len(mine) != 4:
        return np.asarray(theirs - mine)
    theirs = same_way(theirs[None], mine[None])[0]
    turn = theirs[:3] * mine[3] - mine[:3] * theirs[3] - np.cross(theirs[:3], mine[:3])
    return np.asarray(2 * turn)

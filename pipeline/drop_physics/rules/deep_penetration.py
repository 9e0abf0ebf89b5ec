"""`deep-penetration`: bodies overlap by a good part of the thinner one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import Pairs
from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.rules.asked_of_bodies import strained_by
from drop_physics.rules.runs import Runs, consecutive

Int64 = NDArray[np.int64]

OVERLAP_M = 1e-3
SHARE, LASTING, MOST = 0.2, 0.1, 0.5
"""Of the thinner one's shortest edge: worth saying of an impact, and of what lasts; and no physics
any more if it stays."""
SOON = 4
"""Steps in which an impact is over."""
JUMPED = 2.0
"""Times what an approach gives in a step, that is deeper."""
GROWS = 10
"""In fewer steps than this nothing presses it in."""
CONSTRAINT, MOTOR = "constraint", "motor"
RATIO, MOST_RATIO = 10.0, 2e3
"""Of masses, beyond which it takes the solver many iterations; and beyond which, more than 500."""


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """Consecutive steps in which a pair overlaps."""

    first: int
    last: int
    placed: bool
    """Whether a call had placed one of them for it."""
    carried: int
    """In how many steps a call had placed one of them, without a velocity."""
    presses: str
    """What presses them together: `constraint`, `motor` or nothing."""
    began_m: float
    """How deep it was at first."""
    depth_m: float
    deepest: int
    links: tuple[int, int]
    """Those that overlap most."""
    came_m: float
    """How far they approached each other until it was deepest, step by step; the most in a step."""
    fastest_m: float
    all_m: float
    """How far until the last of them."""

    def then(self, more: Overlap) -> Overlap:
        """Return both as one."""
        deeper = more if more.depth_m > self.depth_m else self
        before_m = self.all_m if deeper is more else 0.0
        return replace(
            deeper,
            first=self.first,
            last=more.last,
            placed=self.placed,
            began_m=self.began_m,
            carried=self.carried + more.carried,
            presses=self.presses or more.presses,
            came_m=before_m + deeper.came_m,
            all_m=self.all_m + more.all_m,
            fastest_m=max(self.fastest_m, deeper.fastest_m),
        )


class DeepPenetration(Answer):
    """The cause is named only where the sum or the calls show it."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._runs: Runs[Overlap] = Runs(lambda _, each: each.depth_m)
        self._end: dict[int, int] = {}

    def see(self) -> None:
        """Take a piece."""
        for number, judged in self.scene.judged.items():
            self._end[number] = int(judged.steps[-1])
        pairs = self.scene.touches.pairs
        for both, rows in consecutive(pairs, pairs.depth_m > OVERLAP_M):
            self._runs.add(both, self._overlap(pairs, rows))

    def _overlap(self, pairs: Pairs, rows: NDArray[np.intp]) -> Overlap:
        steps, bodies, points = pairs.step[rows], pairs.body[rows], pairs.points
        moved = self.scene.placing.moved(bodies, steps[:, None])
        came_m = pairs.most(points.approach_m_s)[rows].clip(0.0) * pairs.timestep_s[rows]
        # A body that came with the step before may be listed as touching only now.
        late = self.scene.placing.moved(bodies[0], steps[0] - 1).any()
        placed = bool(moved[0].any() or (late and pairs.depth_m[rows[0]] > JUMPED * came_m[0]))
        still = ~points.began_m_s[pairs.starts[rows]].any(axis=2)
        until = int(np.argmax(pairs.depth_m[rows]))
        its = np.flatnonzero(pairs.row == rows[until])
        first, second = points.link[its[int(np.argmin(points.distance_m[its]))]].tolist()
        return Overlap(
            first=int(steps[0]),
            last=int(steps[-1]),
            placed=placed,
            carried=int((moved & still).any(axis=1).sum()),
            presses=max(_presses(self.scene, each, steps) for each in bodies[0].tolist()),
            began_m=float(pairs.depth_m[rows[0]]),
            depth_m=float(pairs.depth_m[rows[until]]),
            deepest=int(steps[until]),
            links=(first, second),
            came_m=float(came_m[: until + 1].sum()),
            fastest_m=float(came_m[: until + 1].max()),
            all_m=float(came_m.sum()),
        )

    def findings(self) -> Iterator[Finding]:
        """Yield the deepest overlap of each pair that had not been placed so."""
        for first, second, overlap in self._runs.most():
            if overlap.placed and overlap.carried <= 1:
                continue  # `starts-in-contact`
            if not {first, second} & self._end.keys():
                continue
            thin_m = self._thinner_m((first, second), overlap.links)
            lasts = overlap.deepest - overlap.first >= GROWS  # what comes fast goes deeper
            if overlap.depth_m > (LASTING if lasts else SHARE) * thin_m:
                finding = self._finding(first, second, overlap, thin_m)
                if finding.advice is not None or overlap.depth_m > MOST * thin_m:
                    yield finding  # without a cause, only what is no physics any more

    def _finding(self, first: int, second: int, overlap: Overlap, thin_m: float) -> Finding:
        moving = [each for each in (second, first) if each in self._end]
        body = moving[0]
        other = first if body == second else second
        stays = overlap.last >= self._end[body]
        share = overlap.depth_m / thin_m
        cause, advice = self._cause(body, other, overlap)
        message = Message(
            "{body} is {depth:.3g} mm inside {other} at {time:.4g} s, {share:.0%} of the thinner "
            "one",
            body=self.scene.body(body).label,
            other=self.scene.body(other).label,
            depth=overlap.depth_m * 1e3,
            share=share,
            time=self.scene.times[self.scene.body(body).client].of(overlap.deepest - 1),
        )
        return Finding(
            code="deep-penetration",
            # What a constraint holds inside, a call asked for.
            level="broken" if stays and share > MOST > (overlap.presses == CONSTRAINT) else "model",
            message=message if cause is None else joined(": ", [message, cause]),
            advice=advice,
            body=self.scene.body(body).label,
            other=self.scene.body(other).label,
            effect=Effect(overlap.depth_m, "m"),
            share=share,
            steps=Span(overlap.first, overlap.last, overlap.last - overlap.first + 1),
        )

    def _cause(self, body: int, other: int, overlap: Overlap) -> tuple[str | None, str | None]:
        """Return why, and what changes it; None where that is not sure."""
        took = overlap.deepest - overlap.first
        grows = took >= GROWS and overlap.depth_m > 2 * overlap.began_m
        stiffness_n_m = self._stiffness_n_m(body, other)
        ratio = strained_by(self.scene.seen, [self.scene.body(each) for each in (body, other)])
        if overlap.carried > (overlap.last - overlap.first) / 2:
            return (
                Message("a call moves one of them in each step, and it has no velocity"),
                Message("give it the velocity that it moves with: p.resetBaseVelocity(…)"),
            )
        if grows and overlap.presses == CONSTRAINT:
            return (
                Message(
                    "a constraint presses them together, and the solver ends before it can "
                    "tell which of both has to give"
                ),
                Message("give it less force: p.changeConstraint(…, maxForce=…)"),
            )
        if stiffness_n_m and took >= GROWS:
            return (
                Message("contact there is as soft as {stiffness:.3g} N/m", stiffness=stiffness_n_m),
                Message("raise p.changeDynamics(…, contactStiffness=…), or do without"),
            )
        if took < SOON and not stiffness_n_m and overlap.depth_m <= 1.05 * overlap.came_m:
            return (
                Message("they approach by {way:.3g} mm in one step", way=overlap.fastest_m * 1e3),
                Message("use a shorter timestep: p.setTimeStep(…)"),
            )
        if grows and overlap.presses == MOTOR:
            return (
                Message(
                    "motors press them together, and the solver ends before it can tell which "
                    "of both has to give"
                ),
                Message(
                    "give the motors less force, or raise "
                    "p.setPhysicsEngineParameter(numSolverIterations=500)"
                ),
            )
        if RATIO <= ratio <= MOST_RATIO and took >= GROWS:
            return (
                Message(
                    "one is {ratio:.3g} times as heavy as the other, and the solver uses up "
                    "its iterations",
                    ratio=ratio,
                ),
                Message("raise p.setPhysicsEngineParameter(numSolverIterations=500)"),
            )
        return None, None

    def _stiffness_n_m(self, *bodies: int) -> float:
        """Return the stiffness that their contacts were given; 0 without any."""
        told = [
            each.reported["contact_stiffness"]
            for each in self.scene.seen.dynamics
            if each.body.number in bodies
        ]
        return max([0.0, *(float(np.nan_to_num(each).max()) for each in told)])

    def _thinner_m(self, bodies: tuple[int, int], links: tuple[int, int]) -> float:
        """Return the shortest edge of what overlaps and can move."""
        edges = []
        for number, link in zip(bodies, links, strict=True):
            boxes = np.reshape(self.scene.body(number).bounds_m, (-1, 2, 3))
            if number in self._end and link + 1 < len(boxes):
                edges.append(float((boxes[link + 1, 1] - boxes[link + 1, 0]).min()))
        return max(min(edges, default=np.inf), 1e-9)


def _presses(scene: Scene, body: int, steps: Int64) -> str:
    """Return what acts against the contacts of a body in some steps."""
    for _, each in scene.stretches(body):
        at = np.flatnonzero(np.isin(each.steps, steps))
        if not len(at) or not each.terms:
            continue
        contacts = each.terms["contacts"][at]
        for term, name in (("constraints", CONSTRAINT), ("motors", MOTOR)):
            against = -np.minimum(each.terms[term][at] * contacts, 0.0).sum(axis=1)
            if (against > 0.5 * (contacts**2).sum(axis=1)).any():
                return name
    return ""

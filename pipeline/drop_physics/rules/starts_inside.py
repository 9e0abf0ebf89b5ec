"""`starts-in-contact`, `static-parent`: what overlaps as a run or an episode begins.

MuJoCo's contacts push what overlaps apart over many steps, so how fast they do is known only when
they have let go.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Notes, Scene, Span
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import effort
from drop_physics.rules.thresholds import DEEP_M, EACH_STEP, THROWN_M
from drop_physics.trace.events import Body

STANDARD_M_S2 = 9.81
BASE = -1


@dataclass
class OverlapAtFirst:
    """A pair that overlaps where a run or a call has placed one of them, until it lets go."""

    first: int
    last: int
    depth_m: float
    parting_m_s: float = 0.0


class StartsInside(Answer):
    """Bodies of different trees that overlap as they are placed, and are thrown apart."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._open: dict[tuple[int, int], OverlapAtFirst] = {}
        self._found: dict[tuple[int, int], OverlapAtFirst] = {}

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        if not len(pairs.starts):
            return
        placed = self.scene.placing.placed(pairs.body, pairs.step[:, None]).any(axis=1)
        parting = pairs.most(pairs.points.parting_m_s)
        starts = placed & (pairs.depth_m > DEEP_M) & (pairs.normal_n > 0)
        for first, second, rows in pairs.by_pair():
            if first == second:
                continue
            for row in rows.tolist():
                step, known = int(pairs.step[row]), self._open.get((first, second))
                if known is not None and step != known.last + 1:
                    del self._open[first, second]
                    known = None
                if starts[row]:
                    known = OverlapAtFirst(step, step, float(pairs.depth_m[row]))
                    self._open[first, second] = known
                if known is None:
                    if not starts[rows].any():
                        break
                    continue
                known.last = step
                known.parting_m_s = max(known.parting_m_s, float(parting[row]))
                best = self._found.get((first, second))
                if best is None or known.parting_m_s > best.parting_m_s:
                    self._found[first, second] = known

    def findings(self) -> Iterator[Finding]:
        """Yield each pair that was thrown apart."""
        for both, found in self._found.items():
            height_m = found.parting_m_s**2 / (2 * STANDARD_M_S2)
            if height_m < THROWN_M:
                continue
            body, other = sorted(
                (self.scene.body(number) for number in both),
                key=lambda each: (bool(each.moving), each.number),
                reverse=True,
            )
            call = Message(
                "place it at least {depth:.3g} mm farther away from {other}",
                depth=found.depth_m * 1e3,
                other=other.label,
            )
            yield Finding(
                code="starts-in-contact",
                level="asked",
                message=Message(
                    "{body} begins {depth:.3g} mm inside {other} at {time:.4g} s: contacts push "
                    "them apart, at up to {speed:.3g} m/s",
                    body=body.label,
                    depth=found.depth_m * 1e3,
                    other=other.label,
                    time=self.scene.times[body.client].of(found.first - 1),
                    speed=found.parting_m_s,
                ),
                advice=call,
                cure=Cure("lifted", body.label, found.depth_m, call),
                body=body.label,
                other=other.label,
                effect=Effect(found.depth_m, "m"),
                share=height_m / THROWN_M,
                steps=Span(found.first, found.last, found.last - found.first + 1),
            )


class StaticParent(Answer):
    """A body collides with its parent where that cannot move, and with no other parent."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: Notes[tuple[int, int, int]] = Notes()
        """How deep a link and its parent are in each other [m], by body and link."""
        self._steps: dict[int, int] = {}

    def see(self) -> None:
        """Take a piece."""
        points = self.scene.touches.pairs.points
        own = np.flatnonzero((points.body[:, 0] == points.body[:, 1]) & (points.normal_n > 0))
        for number, judged in self.scene.judged.items():
            self._steps[number] = self._steps.get(number, 0) + len(judged.steps)
            its = own[points.body[own, 0] == number]
            for a, b in np.unique(points.link[its], axis=0).tolist():
                body = judged.body
                link, parent = max(a, b), min(a, b)
                if not _is_static(body, parent) or _parent(body, link) != parent:
                    continue
                rows = its[(points.link[its] == (a, b)).all(axis=1)]
                step, which = np.unique(points.step[rows], return_inverse=True)
                force, depth = np.zeros(len(step)), np.zeros(len(step))
                np.add.at(force, which, points.normal_n[rows])
                np.maximum.at(depth, which, -points.distance_m[rows])
                self._found.add((number, link, parent), step, depth, {"force": force})

    def findings(self) -> Iterator[Finding]:
        """Yield the deepest of each body."""
        worst: dict[int, tuple[int, int]] = {}
        for (number, link, parent), noted in self._found.items():
            often = noted.count >= EACH_STEP * (self._steps[number] - 1)
            if noted.first > 1 or not often or noted.most < DEEP_M:
                continue
            known = worst.get(number)
            if known is None or noted.most > self._found[number, *known].most:
                worst[number] = link, parent
        for number, (link, parent) in worst.items():
            body, noted = self.scene.body(number), self._found[number, link, parent]
            inner, outer = body.links[link + 1], body.links[parent + 1]
            call = Message(
                '<contact><exclude body1="{parent}" body2="{body}"/></contact>',
                parent=outer,
                body=inner,
            )
            yield Finding(
                code="static-parent",
                level="asked",
                message=Message(
                    "{body} is {depth:.3g} mm inside {parent} from the first step on, and they "
                    "push each other with up to {force}: parent and child do not collide unless "
                    "the parent cannot move, as here",
                    body=inner,
                    depth=noted.most * 1e3,
                    parent=outer,
                    force=effort(noted.at["force"], "N"),
                ),
                advice=call,
                cure=Cure("exclude", inner, None, call),
                body=body.label,
                effect=Effect(noted.most, "m"),
                share=noted.most / DEEP_M,
                steps=noted.span,
            )


def _parent(body: Body, link: int) -> int:
    """Return the link that another hangs on: of a body with several joints, through all of them."""
    parent = body.joints[link].parent
    while parent != BASE and body.links[parent + 1].startswith(f"{body.links[link + 1]}/"):
        parent = body.joints[parent].parent
    return parent


def _is_static(body: Body, link: int) -> bool:
    return link not in body.moving

"""`starts-in-contact`, `self-collision`: bodies are placed inside others, or inside themselves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Noted, Notes, Scene
from drop_physics.rules.asked_of_bodies import size_m
from drop_physics.trace.events import Body

OVERLAP_M = 1e-3
"""Less is no more than contacts at rest have."""
PUSHED_M_S = 1e-2
"""Slower, nothing moves by it."""
JUMPED = 2.0
"""Times what an approach gives in a step, that is deeper."""
STANDARD_M_S2 = 9.81


class StartsInContact(Answer):
    """The engine pushes what overlaps apart: faster, the deeper and the shorter the timestep."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: Notes[tuple[int, int]] = Notes()
        """By the body that was placed last, and the other: how fast they part."""
        self._deepest: Notes[tuple[int, int]] = Notes()
        """How deep they are in each other [m]."""

    def see(self) -> None:
        """Take a piece."""
        pairs = self.scene.touches.pairs
        points = pairs.points
        # How fast the deepest parts leave each other after the step.
        parting = pairs.most(np.where(points.distance_m < -OVERLAP_M, points.parting_m_s, 0.0))
        deep = (pairs.depth_m > OVERLAP_M) & (pairs.normal_n > 0) & (parting > PUSHED_M_S)
        rows = np.flatnonzero(deep)
        placing, bodies, steps = self.scene.placing, pairs.body[rows], pairs.step[rows, None]
        came_m = pairs.most(points.approach_m_s)[rows].clip(0.0) * pairs.timestep_s[rows]
        jumped = (pairs.depth_m[rows] > JUMPED * came_m + OVERLAP_M)[:, None]
        # A body that came with the step before may be listed as touching only now.
        late = placing.placed(bodies, steps - 1)
        late &= ~np.any(placing.moved(bodies, steps), axis=1, keepdims=True)
        for row in np.flatnonzero(late.any(axis=1)).tolist():
            same = (pairs.body == bodies[row]).all(axis=1) & (pairs.step == steps[row] - 1)
            late[row] &= not (pairs.normal_n[same] > 0).any()
        # What calls set no deeper than its velocity brings it moves on.
        placed = placing.placed(bodies, steps) & (jumped | placing.came(bodies, steps))
        placed |= late & jumped
        for row, (first, second) in zip(rows.tolist(), placed.tolist(), strict=True):
            if first or second:
                # Of two, that which was loaded last, or which alone was placed.
                body, other = pairs.body[row].tolist()[:: -1 if second else 1]
                site = self.scene.placing.site(self.scene.body(body), int(pairs.step[row]))
                rows_of = np.flatnonzero(pairs.row == row)
                deepest = rows_of[np.argmin(points.distance_m[rows_of])]
                links = points.link[deepest].tolist()[:: -1 if second else 1]
                step = pairs.step[[row]]
                self._found.add((body, other), step, parting[[row]], site=site, step=int(step[0]))
                self._deepest.add((body, other), step, pairs.depth_m[[row]], links=links)

    def findings(self) -> Iterator[Finding]:
        """Yield each pair, the deepest first."""
        for (body, other), deepest in sorted(self._deepest.items(), key=lambda pair: -pair[1].most):
            yield self._finding(body, other, self._found[body, other], deepest)

    def _finding(self, number: int, of: int, found: Noted, deepest: Noted) -> Finding:
        body, other, depth_m = self.scene.body(number), self.scene.body(of), deepest.most
        size = min(size_m(each) for each in (body, other))
        values = {
            "body": _named(body, deepest.at["links"][0]),
            "depth": depth_m * 1e3,
            "other": _named(other, deepest.at["links"][1]),
            "speed": found.most,
            "time": self.scene.times[body.client].of(found.at["step"] - 1),
        }
        thrown = found.most**2 / (2 * STANDARD_M_S2) > size
        advice = Message("place it at least {depth:.3g} mm farther away from {other}", **values)
        if number == of:
            message = Message(
                "{body} collides with itself as it starts: it is {depth:.3g} mm inside {other}, "
                "and they are pushed apart at {speed:.3g} m/s",
                **values,
            )
            advice = Message(
                "load it without URDF_USE_SELF_COLLISION, or call p.setCollisionFilterPair(…, 0) "
                "for these links"
            )
        elif self.scene.placing.came(number, found.at["step"]):
            message = Message(
                "{body} is loaded {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed "
                "apart at {speed:.3g} m/s",
                **values,
            )
        else:
            message = Message(
                "{body} is set {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed "
                "apart at {speed:.3g} m/s",
                **values,
            )
        return Finding(
            code="self-collision" if number == of else "starts-in-contact",
            level="model" if number == of else "broken" if thrown else "asked",
            message=message,
            advice=advice,
            body=body.label,
            other=other.label,
            effect=Effect(depth_m, "m"),
            share=depth_m / size,
            steps=found.span,
            site=found.at["site"],
        )


def _named(body: Body, link: int) -> str:
    """Return what a link is called; of a body that has no other, what that is."""
    single = len(body.links) < 2 or link + 1 >= len(body.links)
    return body.label if single else f"{body.label} ({body.links[link + 1]})"

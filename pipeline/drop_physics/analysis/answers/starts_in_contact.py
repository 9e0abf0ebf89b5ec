"""`starts-in-contact`, `self-collision`: bodies are placed inside others, or inside themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.answers.asked_of_bodies import size_m
from drop_physics.analysis.answers.placing import Placing
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

OVERLAP_M = 1e-3
"""Less is no more than contacts at rest have."""
PUSHED_M_S = 1e-3
"""Slower, nothing moves by it."""
STANDARD_M_S2 = 9.81


@dataclass(frozen=True)
class Start:
    """An overlap in the step that a placed body began with."""

    body: int
    """The one that was placed last."""
    other: int
    step: int
    depth_m: float
    parting_m_s: float
    site: str | None


class StartsInContact(Answer):
    """The engine pushes what overlaps apart: faster, the deeper and the shorter the timestep."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._placing = Placing(scene)
        self._found: dict[tuple[int, int], Start] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._placing.see(explained)
        pairs = self.scene.touches.pairs
        rows = np.flatnonzero((pairs.depth_m > OVERLAP_M) & (pairs.normal_n > 0))
        if not len(rows):
            return
        placed = self._placing.placed(pairs.body[rows], pairs.step[rows, None])
        rows, placed = rows[placed.any(axis=1)], placed[placed.any(axis=1)]
        # How fast the deepest parts leave each other after the step.
        points = pairs.points
        parting = pairs.most(np.where(points.distance_m < -OVERLAP_M, points.parting_m_s, 0.0))
        for row, (_, second) in zip(rows.tolist(), placed.tolist(), strict=True):
            if parting[row] < PUSHED_M_S:
                continue
            # Of two, that which was loaded last, or which alone was placed.
            body, other = pairs.body[row].tolist()[:: -1 if second else 1]
            self._note(body, other, int(pairs.step[row]), pairs.depth_m[row], parting[row])

    def _note(self, body: int, other: int, step: int, depth_m: float, parting_m_s: float) -> None:
        site = self._placing.site(self.scene.body(body), step)
        start = Start(body, other, step, float(depth_m), float(parting_m_s), site)
        last = self._found.get((body, other))
        if last is None or start.parting_m_s > last.parting_m_s:
            self._found[body, other] = start

    def findings(self) -> Iterator[Finding]:
        """Yield each pair, the deepest first."""
        for start in sorted(self._found.values(), key=lambda each: -each.depth_m):
            yield self._itself(start) if start.body == start.other else self._finding(start)

    def _finding(self, start: Start) -> Finding:
        body, other = self.scene.body(start.body), self.scene.body(start.other)
        size = min(size_m(each) for each in (body, other))
        thrown = start.parting_m_s**2 / (2 * STANDARD_M_S2) > size
        values = {
            "depth": start.depth_m * 1e3, "other": other.label, "speed": start.parting_m_s,
            "time": self.scene.times[body.client].of(start.step - 1),
        }  # fmt: skip
        if self._placing.loaded(start.body, start.step):
            message = Message(
                "is loaded {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed apart at "
                "{speed:.3g} m/s",
                **values,
            )
        else:
            message = Message(
                "is set {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed apart at "
                "{speed:.3g} m/s",
                **values,
            )
        return Finding(
            code="starts-in-contact",
            level="broken" if thrown else "asked",
            message=message,
            advice=Message(
                "place it at least {depth:.3g} mm farther away from {other}", **values
            ),
            body=body.label,
            other=other.label,
            effect=Effect(start.depth_m, "m"),
            share=start.depth_m / size,
            steps=Span(start.step, start.step, 1),
            site=start.site,
        )  # fmt: skip

    def _itself(self, start: Start) -> Finding:
        body = self.scene.body(start.body)
        return Finding(
            code="self-collision",
            level="model",
            message=Message(
                "collides with itself as it starts: its links overlap by {depth:.3g} mm and are "
                "pushed apart at {speed:.3g} m/s",
                depth=start.depth_m * 1e3, speed=start.parting_m_s,
            ),
            advice=Message(
                "load it without URDF_USE_SELF_COLLISION, or call p.setCollisionFilterPair(…, 0) "
                "for these links"
            ),
            body=body.label,
            other=body.label,
            effect=Effect(start.depth_m, "m"),
            share=start.depth_m / size_m(body),
            steps=Span(start.step, start.step, 1),
            site=start.site,
        )  # fmt: skip

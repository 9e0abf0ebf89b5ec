"""`tunnelled`: a body gets into a box, or through it, and never touches it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.bodies import records_of
from drop_physics.messages import Message
from drop_physics.physics.columns import rotation
from drop_physics.rules.answer import Answer, Effect, Finding, Level, Notes, Scene
from drop_physics.rules.arguments import number as number_of
from drop_physics.rules.arguments import site_of
from drop_physics.rules.asked_of_bodies import size_m
from drop_physics.trace.acts import FILTERS, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, Collision

Float64 = NDArray[np.float64]


class Tunnelled(Answer):
    """Bodies are looked at where steps begin: between two of them nothing is in the way."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._records = records_of(scene.seen)
        put = [each.body.number for each in scene.seen.puts]
        self._boxes = {
            number: body.collisions[0]
            for number, body in scene.seen.bodies.items()
            if len(body.collisions) == 1
            and body.collisions[0].kind == "box"
            and not body.moving
            and put.count(number) <= 1
            and not body.before
        }
        """Of bodies that nothing moves, and which are one box."""
        self._off: dict[frozenset[int], Call] = {}
        """Pairs that a call switched off, by the engine's ids."""
        self._filtered = False
        self._found: Notes[tuple[int, int]] = Notes()

    def see(self) -> None:
        """Take a piece."""
        for call in self.scene.piece.calls.of(*FILTERS):
            if call.act is Act.FILTER_PAIR and number_of(call, "enableCollision", 1.0) == 0:
                ids = (int(number_of(call, f"bodyUniqueId{each}", -1.0)) for each in "AB")
                self._off[frozenset(ids)] = call
            else:
                self._filtered = True
        for judged, steps in self.scene.stretches() if self._boxes and not self._filtered else ():
            body = judged.body
            if body.joints or not body.base_moves:
                continue
            before_m, after_m = steps.before.position_m, steps.after.position_m
            ways_m = np.linalg.norm(after_m - before_m, axis=1)
            for other, box in self._boxes.items():
                if self.scene.body(other).client == body.client:
                    base = self._records[other].told(steps.steps)
                    came, left = _crossing(before_m, after_m, base, box)
                    whole = (came > 0) & (left < 1)
                    # One with a shape, that gets inside, was held off.
                    enters = whole if self._why(body, other) is None else (came > 0) & (came <= 1)
                    rows = np.flatnonzero(enters & (came < left))
                    if len(rows):
                        told = {
                            "step": steps.steps[rows],
                            "share": (left - came)[rows],
                            "timestep": steps.reported.timestep_s[rows],
                        }
                        self._found.add((body.number, other), steps.steps[rows], ways_m[rows], told)

    def _why(self, body: Body, other: int) -> Call | str | None:
        """Return the call that switched a pair off, or that a body has no shape; else None."""
        if not body.collisions:
            return "shapeless"
        return self._off.get(frozenset((body.engine_id, self.scene.body(other).engine_id)))

    def findings(self) -> Iterator[Finding]:
        """Yield each body that went through a box without touching it."""
        for (number, other), found in self._found.items():
            body, box = self.scene.body(number), self.scene.body(other)
            touched = [each.other for each in self.scene.touches.rows(number)]
            if self._filtered or box.label in touched:
                continue  # they may be meant to pass; or it was held off, and pushed through
            why = self._why(body, other)
            level: Level = "asked"
            times = self.scene.times[body.client]
            values = {"body": body.label, "other": box.label, "time": times.of(found.at["step"])}
            if isinstance(why, Call):
                level = "note"
                message = Message(
                    "{body} passes through {other} at {time:.4g} s: a call of "
                    "p.setCollisionFilterPair switched this pair off",
                    **values,
                )
                advice = Message("p.setCollisionFilterPair(…, enableCollision=1)")
            elif why is not None:
                message = Message(
                    "{body} passes through {other} at {time:.4g} s: it has no collision shape",
                    **values,
                )
                advice = Message("give it one: p.createCollisionShape(…), in a URDF <collision>")
            else:
                level, thick_m = "broken", found.most * found.at["share"]
                message = Message(
                    "{body} passes through {other} at {time:.4g} s without touching it: it goes "
                    "{way:.3g} m in one step, and {other} is {thick:.3g} m thick there",
                    **values,
                    way=found.most,
                    thick=thick_m,
                )
                advice = Message(
                    "use a timestep in which it goes less than that: p.setTimeStep({shorter:.1g})",
                    shorter=found.at["timestep"] * found.at["share"] / 2,
                )
            yield Finding(
                code="tunnelled",
                level=level,
                message=message,
                advice=advice,
                body=body.label,
                other=box.label,
                effect=Effect(found.most, "m"),
                share=found.most / size_m(body),
                steps=found.span,
                site=site_of(why) if isinstance(why, Call) else None,
            )


def _crossing(
    before_m: Float64, after_m: Float64, base: Float64, box: Collision
) -> tuple[Float64, Float64]:
    """Return at which shares of their ways points come into a box and leave it, shape (n,) each.

    Slab by slab; a way misses the box where it leaves one before it is in all.
    """
    turns = np.moveaxis(rotation(base[:, 3:7].T), -1, 0)
    shape = np.moveaxis(rotation(np.array(box.orientation)[:, None]), -1, 0)[0]
    half_m = np.array(box.size_m) / 2
    begins, ends = (
        (np.einsum("nji,nj->ni", turns, each - base[:, :3]) - box.position_m) @ shape
        for each in (before_m, after_m)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.array([(face - begins) / (ends - begins) for face in (-half_m, half_m)])
    # What goes along a slab is in it all the way, or never.
    outside, along = np.abs(begins) > half_m, ends == begins
    came = np.where(along, np.where(outside, np.inf, -np.inf), sides.min(axis=0))
    left = np.where(along, np.where(outside, -np.inf, np.inf), sides.max(axis=0))
    return came.max(axis=1), left.min(axis=1)

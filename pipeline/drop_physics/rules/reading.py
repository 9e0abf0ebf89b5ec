"""The rule `reading`: numbers that the script reads and that may mean something else."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Span, so_many
from drop_physics.rules.arguments import site_of
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import EACH_STEP, STALE_M
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.readings import Reading


def _read(seen: Seen, act: Act) -> Iterator[tuple[Reading, Body, int]]:
    """Yield the script's readings by given functions, with body and link; -1 for no link."""
    for reading in seen.readings:
        for subject in reading.targets if reading.act is act else ():
            if body := seen.bodies.get(subject.body):
                yield reading, body, -1 if subject.link is None else subject.link


@input_rule("reading", "note", "reading-stale")
def stale(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """The pose read for a link is one step old, unless the script has it recomputed."""
    ways: dict[int, tuple[float, Reading, Body, int]] = {}
    for each, body, link in _read(seen, Act.READ_LINK):
        way_m = inputs.link_way_m.get((each.number, body.number, link), 0.0)
        late = each.flags.get("computeForwardKinematics", 0) == 0 and each.last_step > 0
        if late and way_m >= ways.get(each.number, (STALE_M,))[0]:
            ways[each.number] = way_m, each, body, link
    for way_m, each, body, link in ways.values():
        yield Case(
            subject=body,
            site=site_of(each),
            values={
                "link": body.links[link + 1],
                "function": each.function,
                "way": way_m * 1e3,
                "part": way_m / STALE_M,
            },
        )


stale.rows(
    SayingRow(
        says=Message(
            "the pose of {link} that p.{function} gives is one step old: {way:.2g} mm where it is "
            "fastest"
        ),
        advice=Message("p.{function}(…, computeForwardKinematics=True) gives that of now"),
        share="part",
    )
)


@input_rule("reading", "note", "reading-stale", engines=MUJOCOS)
def computed_before(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """Quantities derived from positions stay those of the earlier state until recomputed."""
    for client, writes in inputs.lasting.positions.items():
        steps = sorted(writes.steps)
        if len(steps) >= EACH_STEP * seen.steps_of(client) and not writes.is_computed:
            yield Case(
                call=writes.first,
                span=Span(steps[0] + 1, steps[-1] + 1, len(steps)),
                values={"reader": None, "steps": so_many(len(steps))},
            )
    for (_, reader), calls in inputs.lasting.stale.items():
        yield Case(call=calls[0], values={"reader": reader, "n": len(calls)})


computed_before.rows(
    SayingRow(
        when=lambda reader: reader is None,
        says=Message(
            "qpos is written in {steps} and mj_forward is not called before the next step: xpos, "
            "contacts, sensors and all else that is computed are then those of the state before"
        ),
    ),
    SayingRow(
        says=Message(
            "{reader} is called {n:,} times after qpos is written and before mj_forward: what it "
            "gives, and xpos, is that of the state before"
        )
    ),
    like=SayingRow(cure=Remedy("forward", form="read"), share=1.0),
)


@input_rule("reading", "note", "reading-static")
def static(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """The velocity read for a base that only calls move is the one set by a call, or 0."""
    posed = {u.body.number: u for u in inputs.of(Act.SET_POSE) if u.body is not None}
    given = {u.body.number for u in inputs.of(Act.SET_VELOCITY) if u.body is not None}
    for each, body, _ in _read(seen, Act.READ_VELOCITY):
        use = posed.get(body.number)
        if use is None or body.base_moves or body.number in given:
            continue
        if len(use.steps) > 1 and not use.constant("posObj"):
            yield Case(subject=body, site=site_of(each))


static.rows(
    SayingRow(
        says=Message(
            "the velocity of {body} that p.getBaseVelocity gives is 0: it has no mass, and calls "
            "move it by its pose alone"
        ),
        advice=Message("p.resetBaseVelocity(body, …) beside the pose gives it one"),
        share=1.0,
    )
)


@input_rule("reading", "note", "reading-torque")
def torque(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """`getJointState` returns the torque of the motor, and not that of TORQUE_CONTROL.

    Bodies with changing torques are left out: the script may use only the positions from the same
    reading.
    """
    varied = {
        use.body.number
        for use in inputs.of(Act.COMMAND)
        if use.body and not (use.constant("force") or use.constant("forces"))
    }
    said = set[int]()
    for each, body, link in _read(seen, Act.READ_JOINT):
        if (body.number, link) in inputs.torque_alone and not (
            body.number in varied or each.number in said
        ):
            said.add(each.number)
            told = {"joint": body.joints[link].name, "function": each.function}
            yield Case(subject=body, site=site_of(each), values=told)


torque.rows(
    SayingRow(
        says=Message(
            "the torque of {joint} that p.{function} gives is its motor's, which is off: 0, "
            "whatever p.TORQUE_CONTROL applies"
        ),
        advice=Message("the torque is the one that the script gives"),
        share=1.0,
    )
)


@input_rule("reading", "note", "reading-depth")
def depth(seen: Seen) -> Iterator[Case]:
    """The depth buffer of a camera with perspective is not linear in the distance.

    Cameras with more than one image are left out, since they may only serve a video.
    """
    for reading in seen.readings:
        lens = reading.camera
        if lens is None or lens.near_far_m is None or lens.projection[11] == 0 or reading.count > 1:
            continue
        near, far = lens.near_far_m
        if 0 < near < far < np.inf:
            yield Case(site=site_of(reading), values={"near": near, "far": far})
            return


depth.rows(
    SayingRow(
        says=Message(
            "the depth that p.getCameraImage gives is no distance: from 0 at near={near:.3g} m to "
            "1 at far={far:.3g} m, and not linear"
        ),
        advice=Message("far * near / (far - (far - near) * depth) is the distance in m"),
    )
)

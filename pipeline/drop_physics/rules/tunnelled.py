"""Rules about bodies that move too far in one step, such as through a wall."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.bodies import Record
from drop_physics.explain.convex import is_convex
from drop_physics.explain.steps import BodySteps
from drop_physics.fields import fraction
from drop_physics.messages import Message
from drop_physics.physics.columns import rotation
from drop_physics.physics.laws.mujoco.contact import shortest_s
from drop_physics.physics.tree import BASE
from drop_physics.physics.vectors import lengths
from drop_physics.rules.arguments import site_of
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, MUJOCO, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import ENDLESS_M, LONG_S
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, Collision
from drop_physics.trace.history import Seen

FINER, FINEST = 4.0, 1000.0
"""Least and greatest divisor by which a trial reduces the timestep."""
MARGIN = 0.1
"""Share by which a body has to go less far in a step than it is thick."""


@body_rule("tunnelled", "asked", engines=ANY)
def tunnelled(
    bodies: BodyColumns, records: Mapping[int, Record], seen: Seen, inputs: Inputs, chunk: StepChunk
) -> Match | None:
    """A body is on opposite sides of a box before and after a step, or enters and leaves it."""
    tree, body = bodies.law.tree, bodies.batch.bodies[0].body
    if tree.links or not tree.size:
        return None
    before_m, after_m = bodies.before.position_m, bodies.after.position_m
    numbers, which = np.unique(bodies.body, return_inverse=True)
    found = []
    for other, box in _standing(seen):
        if other.client != body.client or not _may_meet(body, other, box):
            continue
        base = records[other.number].base_at(bodies.step)
        came, left = _crossing(before_m, after_m, base, box)
        enters = (came > 0) & (came < left)
        # One with a shape, that gets inside, was held off.
        free = [
            _why(inputs, each, other) is not None
            for each in map(seen.bodies.__getitem__, numbers.tolist())
        ]
        alone = enters & np.where(np.array(free)[which], came <= 1, left < 1)
        through = _through(bodies, base, box, enters & (left < 1))
        # What it touches on the way holds it off, and it is pushed through.
        for rows, touched in ((np.flatnonzero(alone), False), (through, True)):
            its = rows[_touching(bodies, rows, other, chunk) == touched]
            about = np.broadcast_to([other.number, touched], (len(its), 2))
            part = np.where(touched, 1.0, left - came)[its]
            found.append(np.column_stack([its, about, part]))
    if not found:
        return None
    rows, boxes, touches = (each := np.concatenate(found))[:, :3].T.astype(np.int64)
    return Match(
        rows,
        lengths(after_m - before_m)[rows],
        {
            "step": bodies.step[rows],
            "part": each[:, 3],
            "timestep": bodies.reported.timestep_s[rows],
            "touched": touches > 0,
        },
        keys=np.column_stack([bodies.body[rows], boxes, touches]),
    )


def _through(bodies: BodyColumns, base: Float64, box: Collision, at_once: Flags) -> Int64:
    """Return the steps in which a convex body leaves a box on another side than it came from.

    `at_once` flags the steps that lead through the whole box.
    """
    collisions = bodies.batch.bodies[0].body.collisions
    if len(collisions) != 1 or not is_convex(collisions[0]):
        return np.empty(0, np.int64)  # of several shapes the centre may be in none
    place = _in_box(bodies.before.position_m, base, box) / (np.array(box.size_m) / 2)
    outside = np.abs(place) > 1
    steps = np.flatnonzero(outside.any(axis=1))
    # From one step outside to the next, with steps between in which it is inside, or in one.
    last, now = steps[:-1], steps[1:]
    across = (outside[last] & (place[last] * place[now] < -1)).any(axis=1)
    across &= (now - last > 1) | at_once[last]
    across &= bodies.step[now] - bodies.step[last] == now - last
    return np.asarray(now[across & (bodies.body[last] == bodies.body[now])] - 1)


@tunnelled.notes
def _(
    inputs: Inputs,
    seen: Seen,
    subject: Body,
    partner: Body,
    body_size_m: float,
    engine: str,
    time_s: Callable[[int], float],
    step: int,
    size: float,
    part: float,
    timestep: float,
    touched: bool,
) -> Noted | None:
    if subject.client in inputs.filtered:
        return None  # they may be meant to pass
    if touched and engine != MUJOCO:
        return None  # what presses it through contacts that do not yield is `deep-penetration`'s
    why, thick_m, speed_m_s = _why(inputs, subject, partner), size * part, size / timestep
    if touched:
        thick_m = min(min(box.size_m) for each, box in _standing(seen) if each is partner)
    # At critical damping a body stops within 1 / e of the distance that its speed covers in a time
    # constant: in half the wall, with a timestep that is short enough.
    constant_s = float(f"{thick_m / (2 * speed_m_s):.1g}")
    noted: Noted = {
        "time": time_s(step),
        "thick": thick_m,
        "speed": speed_m_s,
        "way": size * min(part, 1.0),
        "share": size / body_size_m,
        "finer": float(min(max(2, math.ceil(2 / part - 1e-6)), FINEST)),
        "constant": constant_s,
        "shorter": max(1, math.ceil(shortest_s(timestep) / constant_s - 1e-6)),
        "shapeless": why is not None,
        "function": None,
    }
    if isinstance(why, Call):
        noted |= {"function": why.function, "called": site_of(why)}
    return noted


SHAPELESS = SayingRow(
    says=Message("{body} passes through {other} at {time:.4g} s: it has no collision shape")
)
STOPS = Remedy("solref", "body", "constant", form="stopping", given={"finer": "shorter"})
TOO_FAR = SayingRow(
    says=Message(
        "{body} passes through {other} at {time:.4g} s without touching it: it goes "
        "{size:.3g} m in one step, and {other} is {thick:.3g} m thick there"
    ),
    level="broken",
)
tunnelled.rows(
    SayingRow(
        when=lambda function: function,
        says=Message(
            "{body} passes through {other} at {time:.4g} s: a call of "
            "p.setCollisionFilterPair switched this pair off"
        ),
        advice=Message("p.setCollisionFilterPair(…, enableCollision=1)"),
        cure=Remedy("without", given={"function": "function"}),
        level="note",
        site="called",
    ),
    SayingRow(
        when=lambda shapeless: shapeless,
        engines=MUJOCOS,
        advice=Message('contype="1" conaffinity="1" of one of its <geom>s'),
        level="note",  # its model says so
    ).like(SHAPELESS),
    SayingRow(
        when=lambda shapeless: shapeless,
        advice=Message("give it one: p.createCollisionShape(…), in a URDF <collision>"),
    ).like(SHAPELESS),
    SayingRow(
        when=lambda touched: touched,
        engines=MUJOCOS,
        says=Message(
            "{body} passes through {other} at {time:.4g} s although they touch: at {speed:.3g} m/s "
            "their contact is too soft to stop it within {thick:.3g} m"
        ),
        cure=STOPS,
        effect="thick",
        normal="body_size_m",
        level="broken",
    ),
    SayingRow(cure=STOPS, engines=MUJOCOS).like(TOO_FAR),
    SayingRow(
        advice=Message("use a timestep in which it goes less than that: {call}"),
        cure=Remedy("timestep", value="finer"),
    ).like(TOO_FAR),
    like=SayingRow(effect="way", share="share"),
)


def _standing(seen: Seen) -> list[tuple[Body, Collision]]:
    """Return the bodies that cannot move, with their boxes."""
    puts = Counter(put.body.number for put in seen.puts)
    return [
        (body, collision)
        for number, body in seen.bodies.items()
        if not (body.moving or body.before or puts[number] > 1)
        for collision in body.collisions
        if (collision.kind, collision.link) == ("box", BASE)
    ]


def _may_meet(body: Body, other: Body, box: Collision) -> bool:
    """Return whether the model's filters let a body touch a box."""
    if (BASE, other.number, BASE) in body.apart or (BASE, body.number, BASE) in other.apart:
        return False
    bits = [collision.bits for collision in body.collisions if collision.bits]
    kind, affinity = box.bits or (0, 0)
    return not bits or any(a & affinity or kind & b for a, b in bits)


def _touching(bodies: BodyColumns, rows: Int64, other: Body, chunk: StepChunk) -> Flags:
    """Flag the rows in which a body touches another one in the same or an adjacent step."""
    pairs, found = chunk.pairs, np.zeros(len(rows), np.bool_)
    for k, number in enumerate(bodies.body[rows]):
        both = (pairs.body == sorted((number, other.number))).all(axis=1)
        found[k] = (np.abs(pairs.step[both] - bodies.step[rows[k]]) <= 1).any()
    return found


def _why(inputs: Inputs, body: Body, other: Body) -> Call | str | None:
    """Return why two bodies made no contact: the call that disabled it, or `shapeless`."""
    if not body.collisions:
        return "shapeless"
    return inputs.passes.get(frozenset(((body.number, BASE), (other.number, BASE))))


def _crossing(
    before_m: Float64, after_m: Float64, base: Float64, box: Collision
) -> tuple[Float64, Float64]:
    """Return the fractions of their paths at which points enter and leave a box, shape (n,) each.

    The box is the intersection of three slabs; a path misses the box if it leaves one slab before
    it has entered all three.
    """
    half_m = np.array(box.size_m) / 2
    begins, ends = (_in_box(each, base, box) for each in (before_m, after_m))
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.array([(face - begins) / (ends - begins) for face in (-half_m, half_m)])
    # What goes along a slab is in it all the way, or never.
    outside, along = np.abs(begins) > half_m, ends == begins
    came = np.where(along, np.where(outside, np.inf, -np.inf), sides.min(axis=0))
    left = np.where(along, np.where(outside, -np.inf, np.inf), sides.max(axis=0))
    return came.max(axis=1), left.min(axis=1)


def _in_box(place_m: Float64, base: Float64, box: Collision) -> Float64:
    """Return positions in the axes of a body's box [m], shape (n, 3)."""
    turns = np.moveaxis(rotation(base[:, 3:7].T), -1, 0)
    shape = np.moveaxis(rotation(np.array(box.orientation)[:, None]), -1, 0)[0]
    of_body = np.einsum("nji,nj->ni", turns, place_m - base[:, :3])
    return np.asarray((of_body - box.position_m) @ shape)


# -- timestep-too-long ----------------------------------------------------------------------------


@body_rule("timestep-too-long", "model", engines=ANY)
def far(bodies: BodyColumns, chunk: StepChunk) -> Match | None:
    """Before or after a contact, a body moves farther in a step than it is thick."""
    if bodies.law.tree.size != 6:
        return None
    step_s = bodies.reported.timestep_s / bodies.whole.substeps
    way_m = lengths(bodies.after.velocity[:, 3:6]) * step_s
    thick_m = bodies.of_each(_thick_m)
    meets = [chunk.touching(bodies.body, bodies.step + later) for later in (0, 1)]
    far = (thick_m > 0) & (thick_m < ENDLESS_M) & (way_m > thick_m) & np.isfinite(way_m)
    pulled = bodies.terms.get("constraints", np.zeros((len(way_m), 1))).any(axis=1)
    numbers = {"step": step_s, "thick": thick_m, "pulled": pulled}
    return Match(far & np.any(meets, axis=0), way_m, numbers)


@far.notes
def _(step: float, size: float, thick: float) -> Noted:
    finer = min(max(FINER, float(math.ceil(size / thick * (1 + MARGIN)))), FINEST)
    return {"step_s": fraction(step), "finer": finer}


far.rows(
    # A call asked for what pulls it, and a shorter timestep may leave that.
    SayingRow(when=lambda pulled: pulled, level="note", proposed=True),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{body} moves {size:.3g} m in a step of {step_s} s, and is {thick:.3g} m thick: it "
            "can pass through others, or overlap them before contact acts"
        ),
        cure=Remedy("timestep", value="finer"),
        effect="size",
        normal="thick",
    ),
)


@body_rule("timestep-too-long", "model", engines=ANY)
def long(bodies: BodyColumns) -> Match:
    """A robot's timestep is so long that motors and contacts react too late."""
    step_s = bodies.reported.timestep_s / bodies.whole.substeps
    jointed = bodies.of_each(lambda each: len(each.body.joints) > 0)
    return Match((step_s > LONG_S) & jointed, step_s)


@long.notes
def _(size: float) -> Noted:
    return {"step_s": fraction(size)}


long.rows(
    SayingRow(
        engines=MUJOCOS,
        says=Message(
            "{body} is simulated in steps of {step_s} s: MuJoCo makes no contact and no limit "
            "stiffer than a time constant of 2 steps, and actuators act on a state as old as a step"
        ),
    ),
    SayingRow(
        says=Message(
            "{body} is simulated in steps of {step_s} s: position motors close a share of "
            "their gap per step, and contacts act only at its end"
        ),
    ),
    like=SayingRow(cure=Remedy("timestep", value=FINER), effect="size", unit="s", normal=LONG_S),
)


def _thick_m(steps: BodySteps) -> float:
    """Return the shortest edge of a body's bounding box [m]; 0 for a body with joints."""
    box = np.array(steps.body.bounds_m[:6])
    return 0.0 if steps.body.joints or len(box) < 6 else float((box[3:] - box[:3]).min())

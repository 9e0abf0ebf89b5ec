"""The rule `no-contact`: bodies overlap although no contact between them is possible."""

from __future__ import annotations

from drop_physics.account.overlaps import HeldShape
from drop_physics.account.rows import AccountRow
from drop_physics.messages import Message
from drop_physics.rules.body_properties import part_named, size_m
from drop_physics.rules.engines import ANY, BULLETS, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import row_rule
from drop_physics.rules.thresholds import DEEP_M, OVERLAPS_STEPS
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.history import Seen


@row_rule("no-contact", "model", engines=ANY, proof="call")
def no_contact(row: AccountRow) -> bool:
    """Shapes between which no contact is possible come to overlap during the run."""
    return "shapes" in row.noted


@no_contact.notes
def _(
    inputs: Inputs,
    seen: Seen,
    shapes: tuple[HeldShape, HeldShape],
    call: Call | None,
    cause: str,
    count: int,
    size: float,
) -> Noted | None:
    one, two = (shape.body for shape in shapes)
    (_, link_one), (_, link_two) = (shape.place for shape in shapes)
    solids = [shape.solid.collision for shape in shapes]
    if count < OVERLAPS_STEPS or frozenset((one.number, two.number)) in inputs.joined:
        return None
    if one is two and cause != "parent-and-child":
        return None
    swims = cause == "bits" and solids[0].kind == "plane" and shapes[0].is_seen
    if swims and size < max(map(size_m, (one, two))):
        return None
    # Such a pair is `tunnelled`'s: a single body and a box that stays.
    by_links = call is not None and call.act is not Act.FILTER_PAIR
    boxes = any(
        a.base_moves and not a.joints and not b.moving and [s.kind for s in b.collisions] == ["box"]
        for a, b in ((one, two), (two, one))
    )
    if cause in ("filter", "no-shape") and boxes and not by_links:
        return None
    asked = {
        subject.body
        for reading in seen.readings
        if reading.act is Act.READ_CONTACTS
        for subject in reading.targets
    }
    if cause == "both-static" and one.number not in asked and two.number not in asked:
        return None
    (type_one, with_one), (type_two, with_two) = (shape.bits or (0, 0) for shape in solids)
    return {
        "type_one": type_one,
        "with_one": with_one,
        "type_two": type_two,
        "with_two": with_two,
        "one": part_named(one, link_one),
        "two": part_named(two, link_two),
        "links": [one.links[link_one + 1], two.links[link_two + 1]],
        "function": "" if call is None else call.function,
    }


BITS = Remedy("contype", given={"links": "links"})
BITS_APART = SayingRow(
    why=Message(
        "contype {type_one} and conaffinity {with_one} of {one} have no bit in common with "
        "conaffinity {with_two} and contype {type_two} of {two}"
    ),
    cure=BITS,
    reason="filter",
    engines=MUJOCOS,
)
no_contact.rows(
    SayingRow(
        when=lambda cause: cause == "flag",
        why=Message("a flag of the model switches all contacts off"),
        cure=Remedy("contype", form="flag"),
        reason="filter",
        engines=MUJOCOS,
    ),
    SayingRow(
        when=lambda cause: cause == "exclude",
        why=Message("an <exclude> of the model names both"),
        cure=Remedy("exclude", form="out", given={"links": "links"}),
        reason="filter",
        engines=MUJOCOS,
    ),
    SayingRow(
        # What meets nothing at all is to be looked through.
        when=lambda cause, type_one, with_one, type_two, with_two: (
            cause == "bits" and not ((type_one or with_one) and (type_two or with_two))
        ),
        level="note",
    ).like(BITS_APART),
    SayingRow(when=lambda cause: cause == "bits").like(BITS_APART),
    SayingRow(
        when=lambda cause: cause == "parent-and-child",
        why=Message("{one} is the parent of {two}, and parent and child do not collide"),
        cure=Remedy("filterparent"),
        reason="parent-and-child",
        engines=MUJOCOS,
    ),
    SayingRow(
        when=lambda cause: cause == "parent-and-child",
        why=Message(
            "{one} is the parent of {two}, and without URDF_USE_SELF_COLLISION_INCLUDE_PARENT "
            "PyBullet makes no contacts between these"
        ),
        advice=Message("load it with p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT as well"),
        reason="parent-and-child",
        level="note",
        engines=BULLETS,
    ),
    SayingRow(
        when=lambda cause: cause == "no-shape",
        why=Message("{one} has no collision shape"),
        advice=Message("give it one: p.createCollisionShape(…), in a URDF <collision>"),
        reason="no-shape",
        level="asked",
        engines=BULLETS,
    ),
    SayingRow(
        when=lambda cause: cause == "both-static",
        why=Message("neither has mass, and PyBullet makes no contacts between two static bodies"),
        advice=Message("give the one that moves a mass: {call}"),
        cure=Remedy("mass", "body"),
        reason="both-static",
        level="asked",
        engines=BULLETS,
    ),
    SayingRow(
        when=lambda cause: cause == "link-counted-static",
        why=Message(
            "{one} is fixed to the first link of a robot whose base is fixed, which makes it "
            "static for PyBullet, as {two} is"
        ),
        advice=Message(
            "make its joint revolute, with limits of -0.001 and 0.001, or give {two} a mass"
        ),
        reason="link-counted-static",
        level="asked",
        engines=BULLETS,
    ),
    SayingRow(
        when=lambda cause: cause == "filter",
        why=Message("a call of p.{function} switched this pair off"),
        advice=Message("leave that call out"),
        reason="filter",
        level="note",
        engines=BULLETS,
    ),
    like=SayingRow(
        says=Message(
            "{one} and {two} go at least {size:gap} into each other, and nothing pushes them "
            "apart: {why}"
        ),
        effect="size",
        normal=DEEP_M,
    ),
)

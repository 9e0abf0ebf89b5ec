"""`no-contact`: bodies overlap without a contact between them, so that nothing separates them."""

from __future__ import annotations

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Scene
from drop_physics.rules.arguments import site_of
from drop_physics.rules.body_properties import part_named
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, unpaired_rule
from drop_physics.rules.thresholds import OVERLAPS_STEPS
from drop_physics.rules.unpaired_columns import UnpairedColumns
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body


@unpaired_rule("no-contact", "asked", least_count=OVERLAPS_STEPS)
def no_contact(pair: UnpairedColumns) -> Match:
    """Links overlap between which the engine makes no contacts."""
    every = np.ones(len(pair.step))
    return Match(every > 0, every, {"why": pair.reason, "switch": pair.call})


@no_contact.notes
def _(scene: Scene, subject: Body, keys: list[int], switch: Call | None, count: int) -> Noted:
    one, two, *links = keys
    other = scene.body(two)
    return {
        "one": part_named(subject, links[0]),
        "two": part_named(other, links[1]),
        "other": None if one == two else other.label,
        "function": "" if switch is None else switch.function,
        "called": None if switch is None else site_of(switch),
        "part": count / max(scene.seen.samples[subject.client] - 1, 1),
    }


no_contact.rows(
    SayingRow(
        when=lambda why: why == "no-shape",
        why=Message("{one} has no collision shape"),
        advice=Message("give it one: p.createCollisionShape(…), in a URDF <collision>"),
        reason="no-shape",
    ),
    SayingRow(
        when=lambda why: why == "both-static",
        why=Message("neither has mass, and PyBullet makes no contacts between two static bodies"),
        advice=Message("give the one that moves a mass: {call}"),
        cure=Remedy("mass", "body"),
        reason="both-static",
    ),
    SayingRow(
        when=lambda why: why == "parent-and-child",
        why=Message(
            "{two} is the parent of {one}, and without URDF_USE_SELF_COLLISION_INCLUDE_PARENT "
            "PyBullet makes no contacts between these"
        ),
        advice=Message("load it with p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT as well"),
        reason="parent-and-child",
        level="note",
    ),
    SayingRow(
        when=lambda why: why == "filter",
        why=Message("a call of p.{function} switched this pair off"),
        advice=Message("leave that call out"),
        reason="filter",
        level="note",
    ),
    SayingRow(
        why=Message(
            "{one} is fixed to the first link of a robot whose base is fixed, which makes it "
            "static for PyBullet, as {two} is"
        ),
        advice=Message(
            "make its joint revolute, with limits of -0.001 and 0.001, or give {two} a mass"
        ),
        reason="link-counted-static",
    ),
    like=SayingRow(
        says=Message("{one} gets into {two} in {count:,} steps, and nothing pushes it out: {why}"),
        share="part",
        site="called",
    ),
)

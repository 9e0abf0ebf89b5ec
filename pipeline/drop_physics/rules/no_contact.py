"""`no-contact`: bodies overlap, and nothing pushes them apart, because they are no pair."""

from __future__ import annotations

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Level
from drop_physics.rules.body_properties import part_named
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, unpaired_rule
from drop_physics.rules.thresholds import OVERLAPS_STEPS
from drop_physics.rules.unpaired_columns import UnpairedColumns


@unpaired_rule("no-contact", "asked", least_count=OVERLAPS_STEPS)
def no_contact(pair: UnpairedColumns) -> Match:
    """Links overlap of which the engine makes no contacts: the others push."""
    every = np.ones(len(pair.step))
    return Match(every > 0, every, {"why": pair.reason, "switch": pair.call})


@no_contact.says
def _(worst: Worst) -> Said:
    one, two, *links = worst.noted.keys[0].tolist()
    body, other = worst.subject, worst.scene.body(two)
    why, advice, name, level = WHY[worst.why]
    call = worst.switch
    values: dict[str, object] = {
        "body": part_named(body, links[0]),
        "other": part_named(other, links[1]),
        "steps": worst.count,
    }
    values["why"] = Message(why, **values, function="" if call is None else call.function)
    return Said(
        message=Message(
            "{body} gets into {other} in {steps:,} steps, and nothing pushes it out: {why}"
        ),
        values=values,
        reason=worst.why,
        level=level,
        advice=advice,
        cure=None if name is None else Cure(name, body.label),
        other=None if one == two else other.label,
        share=worst.count / max(worst.scene.seen.samples[body.client] - 1, 1),
        call=call,
    )


WHY: dict[str, tuple[Message, Message, str | None, Level]] = {
    "no-shape": (
        Message("{body} has no collision shape"),
        Message("give it one: p.createCollisionShape(…), in a URDF <collision>"),
        None,
        "asked",
    ),
    "both-static": (
        Message("neither has mass, and PyBullet makes no contacts between two static bodies"),
        Message("give the one that moves a mass: {call}"),
        "mass",
        "asked",
    ),
    "parent-and-child": (
        Message(
            "{other} is the parent of {body}, and without URDF_USE_SELF_COLLISION_INCLUDE_PARENT "
            "PyBullet makes no contacts between these"
        ),
        Message("load it with p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT as well"),
        None,
        "note",
    ),
    "filter": (
        Message("a call of p.{function} switched this pair off"),
        Message("leave that call out"),
        None,
        "note",
    ),
    "link-counted-static": (
        Message(
            "{body} is fixed to the first link of a robot whose base is fixed, which makes it "
            "static for PyBullet, as {other} is"
        ),
        Message("make its joint revolute, with limits of -0.001 and 0.001, or give {other} a mass"),
        None,
        "asked",
    ),
}
"""Why, what helps, by which intervention, and how grave it is, by reason."""

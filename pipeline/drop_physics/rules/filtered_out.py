"""`no-contact`: bodies penetrate each other because the model excludes contacts between them."""

from __future__ import annotations

from drop_physics.messages import Message
from drop_physics.rules.answer import Scene
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.filtered_columns import FilteredColumns
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, filtered_rule
from drop_physics.rules.thresholds import DEEP_M, OVERLAPS_STEPS


@filtered_rule("no-contact", "model", least_count=OVERLAPS_STEPS, subject=2, engines=MUJOCOS)
def filtered_out(pairs: FilteredColumns) -> Match:
    """Shapes that did not overlap at first, of bodies that never touch, move into each other."""
    return Match(pairs.depth_m > DEEP_M, pairs.depth_m, {"pair": pairs.keys[:, 2]})


@filtered_out.notes
def _(scene: Scene, pair: int, size: float) -> Noted | None:
    found = scene.filtered.pairs[pair]
    if found.bodies in scene.inputs.touched:
        return None
    bodies = [scene.body(number) for number in found.bodies]
    shapes = [solid.collision for solid in found.solids]
    seen = any(shape.kind == "plane" and not any(shape.bits or ()) for shape in shapes)
    if seen and size < max(map(size_m, bodies)):
        return None  # it may swim
    itself = bodies[0] is bodies[1]
    links = [body.links[shape.link + 1] for body, shape in zip(bodies, shapes, strict=True)]
    a, b = (
        link if itself or len(body.links) > 1 else body.label
        for body, link in zip(bodies, links, strict=True)
    )
    (type_a, with_a), (type_b, with_b) = (shape.bits or (0, 0) for shape in shapes)
    bits = {"type_a": type_a, "with_a": with_a, "type_b": type_b, "with_b": with_b}
    other = None if itself else bodies[1].label
    return {"found": found, "a": a, "b": b, "links": links, "other": other, **bits}


filtered_out.rows(
    SayingRow(
        when=lambda found: found.is_off,
        why=Message("a flag of the model switches all contacts off"),
        cure=Remedy("contype", form="flag"),
    ),
    SayingRow(
        when=lambda found: found.is_excluded,
        why=Message("an <exclude> of the model names both"),
        cure=Remedy("exclude", form="out", given={"links": "links"}),
    ),
    SayingRow(
        when=lambda found: found.is_family,
        why=Message("{a} is the parent of {b}, and parent and child do not collide"),
        cure=Remedy("filterparent"),
        reason="parent-and-child",
    ),
    SayingRow(
        why=Message(
            "contype {type_a} and conaffinity {with_a} of {a} have no bit in common with "
            "conaffinity {with_b} and contype {type_b} of {b}"
        ),
        cure=Remedy("contype", given={"links": "links"}),
    ),
    like=SayingRow(
        says=Message("{a} and {b} go at least {size:gap} into each other and never touch: {why}"),
        effect="size",
        normal=DEEP_M,
        reason="filter",
    ),
)

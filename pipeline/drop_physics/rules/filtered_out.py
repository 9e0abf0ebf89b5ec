"""`no-contact`: bodies go into each other, and the model lets no contact be made between them."""

from __future__ import annotations

from drop_physics.messages import Message
from drop_physics.quantities import gap as distance
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.filtered_columns import FilteredColumns
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, filtered_rule
from drop_physics.rules.thresholds import DEEP_M, OVERLAPS_STEPS
from drop_physics.trace.events import Body


@filtered_rule("no-contact", "model", least_count=OVERLAPS_STEPS, subject=2, engines=MUJOCOS)
def filtered_out(pairs: FilteredColumns) -> Match:
    """Shapes that did not overlap at first, of bodies that never touch, go into each other."""
    return Match(pairs.depth_m > DEEP_M, pairs.depth_m, {"pair": pairs.keys[:, 2]})


@filtered_out.says
def _(worst: Worst) -> Said | None:
    pair, scene = worst.scene.filtered.pairs[worst.pair], worst.scene
    if pair.bodies in scene.inputs.touched:
        return None
    bodies = [scene.body(number) for number in pair.bodies]
    itself, shapes = bodies[0] is bodies[1], [solid.collision for solid in pair.solids]
    seen = any(shape.kind == "plane" and not any(shape.bits or ()) for shape in shapes)
    if seen and worst.size < max(map(size_m, bodies)):
        return None  # it may swim
    both = [*zip(bodies, shapes, strict=True)]
    links = [body.links[shape.link + 1] for body, shape in both]
    a, b = links if itself else [_named(body, shape.link) for body, shape in both]
    values: dict[str, object] = {"a": a, "b": b, "depth": distance(worst.size, "m")}
    if pair.is_off:
        why = Message("a flag of the model switches all contacts off")
        cure = Cure("contype", form="flag")
    elif pair.is_excluded:
        why = Message("an <exclude> of the model names both")
        cure = Cure("exclude", form="out", given={"links": links})
    elif pair.is_family:
        why = Message("{a} is the parent of {b}, and parent and child do not collide", **values)
        cure = Cure("filterparent")
    else:
        (type_a, with_a), (type_b, with_b) = (shape.bits or (0, 0) for shape in shapes)
        bits = {"type_a": type_a, "with_a": with_a, "type_b": type_b, "with_b": with_b}
        why = Message(
            "contype {type_a} and conaffinity {with_a} of {a} have no bit in common with "
            "conaffinity {with_b} and contype {type_b} of {b}",
            **bits,
            **values,
        )
        cure = Cure("contype", given={"links": links})
    return Said(
        message=Message(
            "{a} and {b} go at least {depth} into each other and never touch: {why}",
            why=why,
            **values,
        ),
        cure=cure,
        reason="parent-and-child" if pair.is_family else "filter",
        other=None if itself else bodies[1].label,
        effect=Effect(worst.size, "m"),
        share=worst.size / DEEP_M,
    )


def _named(body: Body, link: int) -> str:
    return body.label if len(body.links) < 2 else body.links[link + 1]

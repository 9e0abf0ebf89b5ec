"""Rows for lines of the script that use an engine's array to another effect than it seems."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.account.rows import AccountRow, Kind
from drop_physics.messages import Message, joined
from drop_physics.quantities import number, quantity
from drop_physics.trace.events import ArrayUse, located
from drop_physics.trace.history import Seen

SALIENCE = 30.0
"""The salience of such rows: what they say is proved by memory, and no force tells it."""
LENGTHS = "xpos", "xipos", "subtree_com"
"""Endings of the names of arrays in metres."""


def array_use_rows(seen: Seen) -> Iterator[AccountRow]:
    """Yield a row for each such line."""
    for use in seen.array_uses:
        kind: Kind = "reads"
        if use.use == "kept":
            told = Message(
                "{name} is kept in {count:,} steps or more, without a copy: all of these are one "
                "array, which shows its latest values",
                name=use.name,
                count=use.count,
            )
        elif use.use == "stale":
            told = _stale(use)
        elif use.use == "overwritten":
            kind = "set"
            told = Message(
                "{name} is written before {count:,} steps or more, to no effect: each step "
                "computes it anew before it is used",
                name=use.name,
                count=use.count,
            )
        elif use.use == "edited":
            kind, told = "set", _edited(use)
        else:
            kind, told = "given", _left(use, seen)
        yield AccountRow(
            kind=kind,
            site=located(use.file, use.line),
            told=told,
            got=use.size or None,
            step=use.at.step,
            salience=SALIENCE,
            group=(use.use, use.file, use.line),
        )


def _stale(use: ArrayUse) -> Message:
    """Describe how far a reading is off what the engine computes next."""
    unit = "m" if use.name.endswith(LENGTHS) else ""
    name = Message("{name} of {element}", name=use.name, element=use.element)
    return Message(
        "{name} is read after positions were set and before it is computed from them: it is "
        "{off} off what the engine computes next",
        name=name if use.element else use.name,
        off=quantity(use.size, unit) if unit else number(use.size),
    )


def _left(use: ArrayUse, seen: Seen) -> Message:
    """Describe a force that stays where the script has left it."""
    name = Message("{name} of {element}", name=use.name, element=use.element)
    steps = seen.samples.get(use.client, 1) - 1
    return Message(
        "{name} is used before {count:,} steps, for the last time before step {last:,} of "
        "{steps:,}, and is not 0 then: a force stays until it is written again",
        name=name if use.element else use.name,
        count=use.count,
        last=use.last_step,
        steps=steps,
    )


def _edited(use: ArrayUse) -> Message:
    """Describe which fields of a model did not follow one that the script changed."""
    told = Message(
        "{name} of {element} is changed from {old} to {new} before the first step, which is made "
        "here; {others} belong to it, and are still as compiled",
        name=use.name,
        element=use.element,
        old=number(use.old),
        new=number(use.size),
        others=joined(", ", use.others),
    )
    if len(use.others) == 1:
        told = Message(
            "{name} of {element} is changed from {old} to {new} before the first step, which is "
            "made here; {other} belongs to it, and is still as compiled",
            name=use.name,
            element=use.element,
            old=number(use.old),
            new=number(use.size),
            other=use.others[0],
        )
    if use.count > 1:
        told = told + Message("; {more:,} more elements likewise", more=use.count - 1)
    return told

"""The report of an expectation: its outcome, and single changes with which it is met."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from drop_physics.experiments.motion import fastest
from drop_physics.experiments.search import BranchedTrial
from drop_physics.fields import all_of, counted
from drop_physics.messages import Message, joined
from drop_physics.quantities import DIGITS, number, quantity
from drop_physics.report.blocks import Section, Words
from drop_physics.report.tried import TriedRow, table_of

if TYPE_CHECKING:
    from drop_physics.experiments.ranking import SaidChange
    from drop_physics.experiments.search import ChangeOutcome, TriedChange
    from drop_physics.stages.why.expect import Expected

FAILS = 3
"""Exit code if the expectation failed."""
SHOWN = 3
"""Number of changes shown without `--all`."""
ROUNDING = 1e-6
"""A quantity is shown as 0 if it is below this share of the reached value."""
MOST_DIGITS = 12
"""Most digits of a quantity that is close to the number that it is compared with."""
MOST_COMMANDS = 2
"""Most commands listed that the run with a change follows worse."""


# -- as JSON --------------------------------------------------------------------------------------

NOTHING: dict[str, Any] = {
    "expectation": None,
    "chaotic": False,
    "complete": True,
    "makes_true": [],
    "moves": [],
}
"""JSON values of a run without an expectation."""


def json_of(found: Expected) -> dict[str, Any]:
    """Return the part of the JSON object that describes an expectation."""
    base = found.base
    least = [*found.least, *[None] * len(found.makes_true)]
    recordings = [*found.recordings, *[None] * len(found.makes_true)]
    latest = [*found.latest, *[None] * len(found.makes_true)]
    branched = [*found.branched, *[BranchedTrial()] * len(found.makes_true)]
    lines = [None if each is None else each[0] for each in found.lines]
    places = _places(found)
    made = zip(found.makes_true, least, places, recordings, lines, latest, branched, strict=False)
    return {
        "expectation": {
            "text": found.text,
            "source": found.source,
            "site": found.site,
            "holds": base.holds,
            "value": base.value,
            "margin": base.margin,
            "unit": found.unit,
        },
        "chaotic": found.chaotic,
        "complete": found.complete,
        "makes_true": [
            {
                **_json_of(found, each.tried, each.side_m, factor),
                "row": each.row,
                "ties": [_named(found, one) for one in each.alike],
                "also": [{**_named(found, one), "result": one.outcome.value} for one in each.also],
                "place": place,
                "recording": recording,
                "site": line,
                "from_step": step,
                "second_before": _second_before(found, trial),
                "alone": each.is_alone,
            }
            for each, factor, place, recording, line, step, trial in made
        ],
        "moves": [
            {**_json_of(found, each, None, None), "ties": [], "also": [], "place": None}
            for each in found.moves
        ],
    }


def _second_before(found: Expected, trial: BranchedTrial) -> dict[str, Any] | None:
    if trial == BranchedTrial():
        return None
    return {"from_step": found.second_before, **asdict(trial)}


def _json_of(
    found: Expected, tried: TriedChange, side_m: float | None, least: float | None
) -> dict[str, Any]:
    change = tried.change
    operand = change.how[1]
    return {
        **_named(found, tried),
        "value": operand if isinstance(operand, int | float) else None,
        "least": least,
        "call": found.words(change),
        "result": tried.outcome.value,
        "side": side_m,
        "breaks": change.breaks,
        "worse": [*tried.worse],
        "thrown": tried.thrown and {"body": tried.thrown[0], "value": tried.thrown[1]},
        "row": None,
        "from_step": None,
        "second_before": None,
        "alone": False,
        "recording": None,
    }


def _named(found: Expected, tried: TriedChange) -> dict[str, Any]:
    change = tried.change
    site = None if change.site is None else ":".join(map(str, change.site))
    names = {"change": change.change, "target": [*change.target], "op": change.op}
    return {**names, "site": site, "try": found.repeats(change)}


# -- as lines -------------------------------------------------------------------------------------


def sections_of(found: Expected, *, every: bool) -> Iterator[Section]:
    """Yield the expectation, its outcome, and the changes that help; all of them if `every`."""
    base = found.base
    expected, value = _asked(found), _value(found, base)
    words = (
        Message("{expected}: yes, {value}", expected=expected, value=value)
        if base.holds
        else Message("{expected}: no, {value}", expected=expected, value=value)
    )
    yield Section([Words(words, key=found.text, indent="  ")], apart=False)
    if base.holds:
        return
    if found.chaotic:
        words = Message(
            "chance decides: moved by 1e-9 before the first step, it comes out {noise} away, and "
            "{margin} is missing; no change was tried",
            noise=number(found.noise or 0.0),
            margin=number(abs(base.margin)),
        )
        yield Section([Words(words)])
        return
    tried = Message(
        "{changes} tried, one at a time, in {seconds:.0f} s; {number}",
        changes=counted(found.tried, "change"),
        seconds=found.seconds,
        number=_how_many(len(found.makes_true)),
    )
    blocks: list[Any] = [Words(tried)]
    shown = found.makes_true if every else found.makes_true[:SHOWN]
    if shown:
        least, latest = ([*each, *[None] * len(shown)] for each in (found.least, found.latest))
        branched = [*found.branched, *[BranchedTrial()] * len(shown)]
        facts = zip(shown, least, found.lines, latest, branched, strict=False)
        rows = [
            TriedRow(str(place), _value(found, each[0].tried.outcome), _told(found, *each))
            for place, each in zip(_places(found), facts, strict=False)
        ]
        blocks.append(table_of(rows))
    elif found.moves:
        nearest = [
            Message(
                "{change}: {value}",
                change=found.words(each.change),
                value=_value(found, each.outcome),
            )
            for each in found.moves[:SHOWN]
        ]
        blocks.append(Words(Message("the nearest: {changes}", changes=joined("; ", nearest))))
    rest = len(found.makes_true) - len(shown)
    if rest:
        blocks.append(
            Words(Message("and {more} more: --all", more=counted(rest, "outcome")), "dim")
        )
    if not found.complete:
        words = Message("not all changes were tried: there was no time left; --budget gives more")
        blocks.append(Words(words))
    yield Section(blocks)


def _value(found: Expected, outcome: ChangeOutcome) -> str:
    """Format the quantity that an expectation is about, with its unit if known.

    A quantity that is rounding error, compared with that of the script's own run, is shown as 0.
    The number of digits suffices to distinguish the quantity from the expected number.
    """
    is_none = abs(outcome.value) < ROUNDING * abs(found.base.value)
    value, digits = 0.0 if is_none else outcome.value, DIGITS
    if 0 < abs(outcome.margin) < abs(value) < math.inf:
        digits = math.ceil(math.log10(abs(value / outcome.margin))) + 1
    digits = min(max(digits, DIGITS), MOST_DIGITS)
    return quantity(value, found.unit or "", digits=digits)


def _asked(found: Expected) -> str:
    """Describe an expectation, and where it comes from: an option, the script, the account."""
    if found.row is not None:
        return f"{found.row.words}: {found.text}"
    return found.text if found.site is None else f"{found.site}: assert {found.text}"


def _how_many(outcomes: int) -> str:
    if not outcomes:
        return Message("none of these makes it true")
    if outcomes == 1:
        return Message("one makes it true")
    return Message("{number} make it true", number=outcomes)


def _places(found: Expected) -> list[int]:
    """Return the rank of each change; equally good ones share a rank."""
    places: list[int] = []
    for number_, each in enumerate(found.makes_true, 1):
        before = found.makes_true[number_ - 2] if number_ > 1 else None
        alike = before is not None and (
            before.tried.change.breaks == each.tried.change.breaks
            and math.isclose(before.side_m, each.side_m, rel_tol=0.01)
        )
        places.append(places[-1] if alike else number_)
    return places


def _told(
    found: Expected,
    each: SaidChange,
    least: float | None,
    line: tuple[str, str] | None,
    latest: int | None,
    branched: BranchedTrial,
) -> str:
    """Describe a change that helps, with notes on its limits."""
    parts = [found.words(each.tried.change)]
    if line is not None and each.tried.change.site is None:
        # As elsewhere by its name alone; JSON has the path.
        place, text = line
        parts.append(f"{PurePath(place).name} {text}".rstrip())
    if found.row is not None and each.row == found.row.words:
        parts.append(Message("the row names it, too"))
    if each.tried.change.breaks:
        parts.append(Message("takes a part of the scene or of the command away"))
    if each.tried.worse:
        parts.append(
            Message("follows {commands} worse", commands=all_of(each.tried.worse[:MOST_COMMANDS]))
        )
    if each.tried.thrown is not None:
        body, speed = each.tried.thrown
        at_most = quantity(fastest(found.base.motion)[1], "m/s")
        parts.append(
            Message(
                "{body} is as fast as {speed}, where nothing was above {own}",
                body=body,
                speed=quantity(speed, "m/s"),
                own=at_most,
            )
        )
    if each.is_alone:
        parts.append(Message("a coincidence: neither 5% more nor 5% less does it"))
    operand = each.tried.change.how[1]
    if least is not None and number(least) != number(operand):
        parts.append(Message("×{factor} is enough", factor=number(least)))
    if latest is not None:
        parts.append(Message("from step {step} of {steps} on, too", step=latest, steps=found.steps))
        if call := found.follows(each.tried.change):
            parts[-1] = Message("{later}, with {call} after the edit", later=parts[-1], call=call)
    tried = {
        Message("open loop"): branched.open_loop,
        Message("closed loop"): branched.closed_loop,
    }
    loops = [
        Message("{loop} {holds}", loop=loop, holds=Message("yes") if holds else Message("no"))
        for loop, holds in tried.items()
        if holds is not None
    ]
    if loops:
        parts.append(
            Message(
                "from step {step}, a second before the failure: {loops}",
                step=found.second_before,
                loops=joined(", ", loops),
            )
        )
    if each.also:
        does = joined(
            ", ",
            [
                Message(
                    "{how} ({value})", how=found.does(one.change), value=_value(found, one.outcome)
                )
                for one in each.also
            ],
        )
        parts.append(Message("also {changes}", changes=does))
    if each.alike:
        words = dict.fromkeys(found.words(one.change) for one in each.alike)
        alike = [one for one in words if one != parts[0]]
    else:
        alike = []
    if alike:
        others = joined(", ", alike[:2])
        more = len(alike) - 2
        parts.append(
            Message("the same result: {others} and {more} more", others=others, more=more)
            if more > 0
            else Message("the same result: {others}", others=others)
        )
    if each.row is not None and (found.row is None or each.row != found.row.words):
        row = each.row.partition(";")[0]
        parts.append(Message("the account names it, too: {row}", row=row))
    return joined("; ", parts)

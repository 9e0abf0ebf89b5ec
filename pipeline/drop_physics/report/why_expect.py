"""How results look: what was expected of a script, and which single changes make it true."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import counted
from drop_physics.messages import Message, joined, shell_command
from drop_physics.quantities import number
from drop_physics.report.blocks import Column, DataTable, Report, Section, Words

if TYPE_CHECKING:
    from drop_physics.experiments.ranking import Said
    from drop_physics.experiments.search import Tried
    from drop_physics.stages.why.expect import Expected

Again = Callable[[str], str]

FAILS = 3
"""Exit code if what was expected did not come."""
SHOWN = 3
"""Outcomes that are shown without `--all`."""
MOST_NAMES = 6
"""Names of elements that are written out."""


# -- as JSON --------------------------------------------------------------------------------------


def json_of(found: Expected) -> dict[str, Any]:
    """Return the object that `--json` prints."""
    base, noise = found.base, found.noise
    least = [*found.least, *[None] * len(found.makes_true)]
    made = zip(found.makes_true, least, _places(found), strict=False)
    return dict(
        jsonable(
            {
                "script": found.script,
                "recording": found.recording,
                "ended": found.ended,
                "runs": found.runs,
                "seconds": found.seconds,
                "noise": None if noise is None else {"value": noise, "unit": None},
                "findings": [],
                "hangs_on": [],
                "no_effect": [],
                "shares": None,
                "expectation": {
                    "text": found.text,
                    "source": found.source,
                    "holds": base.holds,
                    "value": base.value,
                    "margin": base.margin,
                    "unit": None,
                },
                "chaotic": found.chaotic,
                "complete": found.complete,
                "makes_true": [
                    {
                        **_json_of(found, each.tried, each.side_m, factor),
                        "ties": [_named(one) for one in each.alike],
                        "place": place,
                    }
                    for each, factor, place in made
                ],
                "moves": [
                    {**_json_of(found, each, None, None), "ties": [], "place": None}
                    for each in found.moves
                ],
            }
        )
    )


def _json_of(
    found: Expected, tried: Tried, side_m: float | None, least: float | None
) -> dict[str, Any]:
    change = tried.change
    operand = change.how[1]
    return {
        **_named(tried),
        "value": operand if isinstance(operand, int | float) else None,
        "least": least,
        "call": found.words(change),
        "result": tried.outcome.value,
        "side": side_m,
        "breaks": change.breaks,
        "row": None,
        "recording": None,
    }


def _named(tried: Tried) -> dict[str, Any]:
    change = tried.change
    site = None if change.site is None else ":".join(map(str, change.site))
    return {"change": change.change, "target": [*change.target], "op": change.op, "site": site}


# -- as lines -------------------------------------------------------------------------------------


def report_of(found: Expected, *, every: bool = False, again: Again | None = None) -> Report:
    """Report what makes it true; the code is 3 if it does not hold. `every`: all of it."""
    del again
    words = Message(
        "{script}: {expected}: {holds}, {value}",
        script=found.script,
        expected=found.text,
        holds=Message("yes") if found.base.holds else Message("no"),
        value=number(found.base.value),
    )
    sections = [] if found.base.holds else [*_sections(found, every=every)]
    view = shell_command("drop", "view", found.recording)
    code = 0 if found.base.holds else FAILS
    return Report(verdict=Words(words, key=found.script), sections=sections, next=[view], code=code)


def _sections(found: Expected, *, every: bool) -> Iterator[Section]:
    if found.chaotic:
        words = Message(
            "chance decides: moved by 1e-9 before the first step, it comes out as expected; no "
            "change was tried"
        )
        yield Section([Words(words)])
        return
    tried = Message(
        "{changes} tried, one at a time, in {seconds:.0f} s; {number}",
        changes=counted(found.tried, "change"),
        seconds=found.seconds,
        number=Message("none makes it true")
        if not found.makes_true
        else Message(
            "{outcomes} of these make it true", outcomes=counted(len(found.makes_true), "outcome")
        ),
    )
    blocks: list[Any] = [Words(tried)]
    shown = found.makes_true if every else found.makes_true[:SHOWN]
    if shown:
        places = [*_places(found)]
        least = [*found.least, *[None] * len(shown)]
        blocks.append(
            DataTable(
                [
                    Column("", [str(place) for place in places[: len(shown)]]),
                    Column("", [found.words(each.tried.change) for each in shown]),
                    Column("", [number(each.tried.outcome.value) for each in shown], right=True),
                    Column(
                        "",
                        [
                            _remarks(found, each, factor)
                            for each, factor in zip(shown, least, strict=False)
                        ],
                        wraps=True,
                    ),
                ],
                has_heads=False,
            )
        )
    elif found.moves:
        nearest = [
            Message(
                "{change}: {value}",
                change=found.words(each.change),
                value=number(each.outcome.value),
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


def _places(found: Expected) -> list[int]:
    """Return the number of each outcome: those that are alike have the same one."""
    places: list[int] = []
    for number_, each in enumerate(found.makes_true, 1):
        before = found.makes_true[number_ - 2] if number_ > 1 else None
        alike = before is not None and (
            before.tried.change.breaks == each.tried.change.breaks
            and math.isclose(before.side_m, each.side_m, rel_tol=0.01)
        )
        places.append(places[-1] if alike else number_)
    return places


def _remarks(found: Expected, each: Said, least: float | None) -> str:
    parts: list[str] = []
    if each.tried.change.breaks:
        parts.append(Message("takes a part of the scene or of the command away"))
    if least is not None:
        parts.append(Message("from ×{factor} on", factor=number(least)))
    if each.alike:
        others = joined(", ", [found.words(one.change) for one in each.alike[:2]])
        more = len(each.alike) - 2
        parts.append(
            Message("the same motion: {others} and {more} more", others=others, more=more)
            if more > 0
            else Message("the same motion: {others}", others=others)
        )
    return joined("; ", parts)

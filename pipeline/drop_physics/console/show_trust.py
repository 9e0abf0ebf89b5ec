"""How results look: what of a script's result stands."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from drop_physics.analysis.results import renamed
from drop_physics.console.output import (
    Column,
    columns_of,
    counted,
    made,
    print_json,
    print_lines,
    table,
    width,
    wrapped,
)
from drop_physics.explain.jsonable import jsonable
from drop_physics.messages import Message, joined, translated
from drop_physics.stages.trust_findings import BY_STEP, TERMS, part_of, readable

if TYPE_CHECKING:
    from drop_physics.experiments.robustness import Standing
    from drop_physics.experiments.run_distance import Distance
    from drop_physics.rules.answer import Finding
    from drop_physics.stages.trust import Trust
    from drop_physics.stages.trust_runs import Varied

Part = Callable[[str, str | None, str], str]
"""Names a position, of its body, joint and unit."""
MOST_PARTS = 6
"""Positions that are listed; all are in the JSON."""
APART = 3
"""The exit code where a variation ends farther apart than it may."""
NONE = "–"
LEAST = 1e-6
"""Of positions that are less apart [m], orientations are shown instead, if they are more [rad]."""
VARIATIONS = (
    "",
    Message("ends apart"),
    "",
    Message("at worst"),
    "",
    Message("apart from"),
    Message("first by"),
)
STANDING = (
    "",
    Message("moves"),
    Message("its end stands to"),
    Message("but for"),
    Message("at worst"),
    Message("but for"),
)
CONVERGENCE = ("converges", "does-not-converge", "no-order")


def show_trust(
    trust: Trust, *, as_json: bool, within: Mapping[str, float], outputs: Sequence[Path] = ()
) -> int:
    """Print what stands, and return the exit code: 3 if a variation ends farther apart."""
    if as_json:
        print_json(json_of(trust))
    else:
        print_lines(
            *trust_lines(trust), *(made(Message("written"), each, column=12)[0] for each in outputs)
        )
    return 0 if trust.ends_within(within) else APART


# -- as JSON --------------------------------------------------------------------------------------


def json_of(trust: Trust) -> dict[str, Any]:
    """Return what `--json` prints."""
    return dict(
        jsonable(
            {
                "script": trust.script,
                "recording": trust.recording,
                "variations": [
                    {
                        "name": each.name,
                        "recording": each.recording,
                        "ended": each.made.ended,
                        "error": each.made.error or None,
                        "steps": each.made.steps,
                        "most": [asdict(one) for one in each.apart.most],
                        "end": [asdict(one) for one in each.apart.end],
                        "from_s": each.apart.from_s,
                        "term": each.term,
                    }
                    for each in trust.variations
                ],
                "standing": [asdict(each) for each in trust.standing],
                "growth": trust.growth and asdict(trust.growth),
                "converging": [asdict(each) for each in trust.converging],
                "findings": renamed(jsonable(trust.findings)),
            }
        )
    )


# -- as lines -------------------------------------------------------------------------------------


def trust_lines(trust: Trust) -> list[str]:
    """Return what the terminal prints."""
    part = _namer(trust)
    rows = [[each.name, *_distances(each, trust, part)] for each in trust.variations]
    lines = [*wrapped(translated(_verdict(trust)), width()), ""]
    lines += _table(VARIATIONS, rows, without=(4,))
    stands = trust.standing[:MOST_PARTS]
    if stands:
        lines += ["", *_table(STANDING, [_stands(each, part) for each in stands], without=(5, 4))]
        if len(trust.standing) > len(stands):
            more = Message(
                "and {more} more: --json",
                more=counted(len(trust.standing) - len(stands), "position"),
            )
            lines.append(f"[dim]{escape(translated(more))}[/]")
    sentences = [*_sentences(trust)]
    if sentences:
        lines.append("")
    for each in sentences:
        lines += [escape(line) for line in wrapped(translated(each), width())]
    folder = trust.recording.parent
    with contextlib.suppress(ValueError):
        folder = folder.relative_to(Path.cwd())
    return [*lines, "", *made(Message("recordings"), folder, column=12)]


def _verdict(trust: Trust) -> Message:
    depends = [each.name for each in trust.variations if each.apart.first is not None]
    stands = [each.name for each in trust.variations if each.apart.first is None]
    script, steps = trust.script, counted(trust.made.steps, "step")
    if not depends:
        return Message(
            "{script}, {steps}: stands; no variation ever comes 1 µm or 1 µrad apart",
            script=script,
            steps=steps,
        )
    if not stands:
        return Message(
            "{script}, {steps}: depends on {depends}",
            script=script,
            steps=steps,
            depends=joined(", ", depends),
        )
    return Message(
        "{script}, {steps}: depends on {depends}; hardly on {stands}",
        script=script,
        steps=steps,
        depends=joined(", ", depends),
        stands=joined(", ", stands),
    )


def _namer(trust: Trust) -> Part:
    """Return what names a position: a joint by itself where no other body has one of that name."""
    tracks = {(track.body, track.joint) for each in trust.variations for track in each.apart.tracks}
    named = Counter(joint for _, joint in tracks)

    def part(body: str, joint: str | None, unit: str) -> str:
        alone = joint is not None and named[joint] == 1
        return joint if joint and alone else translated(part_of(body, joint, unit))

    return part


def _distances(each: Varied, trust: Trust, part: Part) -> list[str]:
    if each.made.ended == "failed" and trust.made.ended != "failed":
        return [translated(Message("fails")), each.made.error[:40], "", "", "", ""]
    first = each.apart.first
    end, most = (_farthest(found, part) for found in (each.apart.end, each.apart.most))
    since = NONE if first is None else f"{first.from_s:.4g} s"
    term = NONE if each.term is None else translated(TERMS[each.term])
    return [*end, *most, since, term]


def _farthest(found: Sequence[Distance], part: Part) -> tuple[str, str]:
    """Return the farthest of several units, and what it is of."""
    if not any(each.value for each in found):
        return "0", ""
    worst = max(found, key=lambda each: (each.unit == "m" and each.value > LEAST, each.value))
    return readable(worst.value, worst.unit), part(worst.body, worst.joint, worst.unit)


def _stands(each: Standing, part: Part) -> list[str]:
    return [
        part(each.body, each.joint, each.unit),
        readable(each.moved, each.unit),
        _digits(each.end_digits, each.end, each.unit),
        each.end_by or "",
        _digits(each.most_digits, each.most, each.unit),
        each.most_by or "",
    ]


def _digits(digits: int | None, off: float, unit: str) -> str:
    if digits is None:
        return translated(Message("all digits"))
    return translated(
        Message("{digits}, ± {off}", digits=counted(digits, "digit"), off=readable(off, unit))
    )


def _table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], *, without: Sequence[int]
) -> list[str]:
    """Return a table's lines, without some of its columns where the terminal has no room."""
    columns: list[Column] = [
        (head, [row[at] for row in rows], False) for at, head in enumerate(heads)
    ]
    for number in without:
        widths = [max(map(columns_of, [translated(head), *cells])) for head, cells, _ in columns]
        if sum(widths) + 2 * len(widths) - 2 > width():
            del columns[number]
    return table(columns)


def _sentences(trust: Trust) -> Iterator[str]:
    """Yield what no table says: the terms in words, growth, convergence, ends of runs."""
    terms = dict.fromkeys(each.term or "" for each in trust.variations if "/" in each.name)
    for term in terms:
        if term in BY_STEP:
            yield BY_STEP[term]
    codes: dict[str, list[Finding]] = {}
    for finding in trust.findings:
        codes.setdefault(finding.code, []).append(finding)
    for code in ("variation-failed", "ends-earlier", "goes-on", "grows", "one-of-many"):
        yield from (each.message for each in codes.get(code, ()))
    if trust.converging:
        yield next(
            each.message
            for each in trust.findings
            if each.code in CONVERGENCE
            and each.body == trust.converging[0].body
            and each.joint == trust.converging[0].joint
        )
    others = len(trust.converging) - 1
    if others > 0:
        converge = sum(each.order is not None for each in trust.converging[1:])
        yield Message(
            "of {others} that depend on it less, {converge} converge",
            others=counted(others, "position"),
            converge=converge,
        )

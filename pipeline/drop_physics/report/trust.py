"""The report of `drop trust`: which of a script's results persist under variations."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.analysis.results import renamed
from drop_physics.explain.cause_names import cause_in_words
from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import counted
from drop_physics.messages import Message, joined, translated
from drop_physics.report.blocks import (
    Block,
    Column,
    DataTable,
    Facts,
    File,
    Graphs,
    Report,
    Section,
    Words,
)
from drop_physics.report.words import MISSING
from drop_physics.stages.trust.findings import BY_STEP, TERMS, part_of, readable
from drop_physics.stages.trust.outputs import distances_of
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

if TYPE_CHECKING:
    from drop_physics.experiments.robustness import Standing
    from drop_physics.experiments.run_distance import Distance
    from drop_physics.rules.answer import Finding
    from drop_physics.stages.trust import Trust
    from drop_physics.stages.trust.runs import Varied

    Again = Callable[[str], str]

Part = Callable[[str, str | None, str], str]
"""Function that returns the display name of a position, from body, joint and unit."""
COLUMN = 12
"""Width of the titles beside files."""
MOST_PARTS = 6
"""Most positions listed; the JSON contains all."""
APART = 3
"""Exit code if a variation ends farther away than allowed."""
LEAST = 1e-6
"""Distance [m] below which orientations are shown instead, if they differ by more [rad]."""
VARIATIONS = (
    "",
    Message("at the end"),
    "",
    Message("at worst"),
    "",
    Message("since"),
    Message("first by"),
)
STANDING = (
    "",
    Message("moves"),
    Message("its end is good to"),
    Message("limited by"),
    Message("at worst"),
    Message("limited by"),
)
CONVERGENCE = ("converges", "does-not-converge", "no-order")


# -- as JSON --------------------------------------------------------------------------------------


def json_of(trust: Trust) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    return dict(
        jsonable(
            {
                "script": trust.script,
                "recording": trust.recording,
                "variations": [
                    {
                        "name": variation.name,
                        "recording": variation.recording,
                        "ended": variation.made.ended,
                        "error": variation.made.error or None,
                        "steps": variation.made.steps,
                        "most": [asdict(one) for one in variation.apart.most],
                        "end": [asdict(one) for one in variation.apart.end],
                        "from_s": variation.apart.from_s,
                        "term": variation.term,
                    }
                    for variation in trust.variations
                ],
                "standing": [asdict(each) for each in trust.standing],
                "growth": trust.growth and asdict(trust.growth),
                "converging": [asdict(each) for each in trust.converging],
                "findings": renamed(jsonable(trust.findings)),
            }
        )
    )


# -- as lines -------------------------------------------------------------------------------------


def report_of(
    trust: Trust,
    *,
    within: Mapping[str, float] | None = None,
    outputs: Sequence[Path] = (),
    again: Again | None = None,
) -> Report:
    """Report which results persist; exit code 3 if a variation ends beyond `within`."""
    part = _namer(trust)
    rows = [[variation.name, *_distances(variation, trust, part)] for variation in trust.variations]
    curves = Graphs(partial(distances_of, trust))
    sections = [Section([_table(VARIATIONS, rows, {4: 1}), curves])]
    stands = trust.standing[:MOST_PARTS]
    if stands:
        table = _table(STANDING, [_stands(stand, part) for stand in stands], {5: 2, 4: 1})
        blocks: list[Block] = [table]
        if len(trust.standing) > len(stands):
            more = counted(len(trust.standing) - len(stands), "position")
            blocks.append(Words(Message("and {more} more: --json", more=more), "dim"))
        sections.append(Section(blocks))
    sentences = [Words(sentence) for sentence in _sentences(trust)]
    if sentences:
        sections.append(Section(sentences))
    folder = trust.recording.parent
    with contextlib.suppress(ValueError):
        folder = folder.relative_to(Path.cwd())
    files = [File(Message("recordings"), folder)]
    files += [File(Message("written"), output) for output in outputs]
    sections.append(Section([Facts(files, COLUMN)]))
    code = 0 if trust.ends_within(within or {}) else APART
    next_ = [] if again is None else [again("why")]
    return Report(verdict=Words(_verdict(trust)), sections=sections, next=next_, code=code)


def _verdict(trust: Trust) -> Message:
    depends = [
        variation.name for variation in trust.variations if variation.apart.first is not None
    ]
    stands = [variation.name for variation in trust.variations if variation.apart.first is None]
    script, steps = trust.script, counted(trust.made.steps, "step")
    if not any(variation.apart.tracks for variation in trust.variations):
        return Message(
            "{script}, {steps}: nothing compared, as nothing moves", script=script, steps=steps
        )
    if not depends:
        return Message(
            "{script}, {steps}: stands; no variation ever differs by 1 µm or 1 µrad",
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
    """Return a function that names positions, by the joint's name alone if it is unique."""
    tracks = {
        (track.body, track.joint)
        for variation in trust.variations
        for track in variation.apart.tracks
    }
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
    since = MISSING if first is None else f"{first.from_s:.4g} s"
    term = MISSING if each.term is None else translated(_term(each.term))
    return [*end, *most, since, term]


def _farthest(found: Sequence[Distance], part: Part) -> tuple[str, str]:
    """Return the largest distance and the name of its position, both as text."""
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
    heads: Sequence[str], rows: Sequence[Sequence[str]], drop: Mapping[int, int]
) -> DataTable:
    """Return a table; `drop` maps column indices to their order of removal if room is short."""
    cells = zip(*rows, strict=True)
    return DataTable(
        [
            Column(head, column, drop=drop.get(at, 0))
            for at, (head, column) in enumerate(zip(heads, cells, strict=True))
        ]
    )


def _term(term: str) -> Message:
    """Return the name of an impulse term for a reader."""
    return TERMS[term] if term in TERMS else cause_in_words(term)


def _sentences(trust: Trust) -> Iterator[str]:
    """Yield sentences on the tables: terms, growth of deviations, convergence, endings."""
    terms = dict.fromkeys(
        variation.term or "" for variation in trust.variations if "/" in variation.name
    )
    for term in terms:
        if term in BY_STEP and trust.made.engine == PYBULLET:
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
            "of the {others} that depend on it less, {converge} converge",
            others=counted(others, "position"),
            converge=converge,
        )

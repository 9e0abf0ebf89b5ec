"""Texts that several reports have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from drop_physics.fields import counted, decimals
from drop_physics.messages import Message, joined
from drop_physics.report.account import sides_of

if TYPE_CHECKING:
    from drop_physics.report.blocks import FindingList
    from drop_physics.rules.answer import Finding

CONTACTS, EXPLAINED = Message("Contacts"), Message("Explained")
NEXT = Message("next")
"""Title of the commands to run next."""
NONE, PLOT = Message("none"), Message("plot")
MISSING = "–"
"""Text shown in place of a missing number."""
RECORDING, SCRIPT = Message("recording"), Message("script")
TERMS = {
    "total": Message("total"),
    "timestep": Message("timestep"),
    "damping": Message("damping"),
    "interaction": Message("interaction"),
    "rounding": Message("rounding"),
}
"""Display names of an error and its terms."""
SEGMENTS = {
    "flight": Message("flight"),
    "contact": Message("contact"),
    "driven": Message("driven"),
    "constrained": Message("constrained"),
    "pushed": Message("pushed"),
    "set": Message("set"),
    "still": Message("still"),
    "unexplained": Message("unexplained"),
}
"""Display names of the kinds of samples."""


def kinds_of_samples(counts: Mapping[str, int]) -> Message:
    """Describe how many samples there are of each kind."""
    return joined(
        ", ",
        [
            Message("{count:,} {kind}", count=count, kind=SEGMENTS[kind])
            for kind, count in counts.items()
            if count
        ],
    )


def unfinished(recording: object, samples: int) -> Message:
    """Return the note that a recording is unfinished."""
    return Message(
        "{recording} was never finished: this is the analysis of the {samples} that it holds, "
        "unverified",
        recording=str(recording),
        samples=counted(samples, "sample"),
    )


def millimetres(value_m: float | None) -> str:
    """Format a length in mm; in powers of ten if four decimals would show only zeros."""
    if value_m is None:
        return MISSING
    value = value_m * 1e3 + 0.0  # no minus before a zero
    small = 0 < abs(value) < 5e-5
    return f"{value:+.1e}" if small else decimals(value, 4, "+")


def besides(found: FindingList) -> Message | None:
    """Return a note below the findings: how many are suppressed, or what was examined."""
    if found.left_out:
        return Message(
            "{findings} left out: --select all", findings=counted(found.left_out, "finding")
        )
    return None if found.findings or found.looked_at is None else found.looked_at


def folded(found: FindingList) -> Message:
    """Return the number of findings that are not shown."""
    hidden = len(found.findings) - found.most
    if found.most:
        return counted(hidden, "more finding")
    return counted(hidden, "finding of little weight", "findings of little weight")


TRIED = {
    "cured": Message("tried {call}: cured"),
    "part": Message("tried {call}: cured in part"),
    "refuted": Message("tried {call}: no effect"),
}
"""Descriptions of a trial's verdict."""
HANGS_ON = Message("the outcome hangs on {call}")
"""Descriptions of verdicts on findings that are causes themselves."""


def beneath(finding: Finding) -> Iterator[Message]:
    """Yield the lines below a finding: terms of the account's row, and results of trials."""
    if finding.terms:
        yield sides_of(finding.terms, "" if finding.row is None else finding.row.mean)
    elif finding.row is not None and finding.row.cause is None:  # else the finding is the row
        yield joined(": ", [finding.row.who, finding.row.told])
    if not finding.tried:
        return
    from drop_physics.experiments.interventions import short
    from drop_physics.experiments.verdicts import CAUSES as DECIDED

    for each in finding.tried:
        hangs = finding.code in DECIDED and each["verdict"] in ("cured", "part")
        shown = HANGS_ON if hangs else TRIED.get(each["verdict"])
        if shown is not None:
            yield Message(shown, call=short(each["call"]))

"""Findings in lines: what was seen, the call that changes it, and where it was made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.markup import escape

from drop_physics.console.output import columns_of, counted, left, wrapped
from drop_physics.console.output import width as columns
from drop_physics.messages import Message, translated

if TYPE_CHECKING:
    from drop_physics.rules.answer import Finding

MOST_FINDINGS = 6
"""That are listed without --verbose; all are in the JSON."""
NUMBER = 3
"""Columns of a finding's number."""
GAP = 3
"""Columns at least before its code, which stands behind the last line where there is room."""


def finding_lines(
    findings: Sequence[Finding], *, verbose: bool, left_out: int = 0, most: int = MOST_FINDINGS
) -> list[str]:
    """Return the findings with their numbers, each with its site and what changes it.

    And how many are not listed, or were left out by choice.
    """
    lines: list[str] = []
    shown = findings if verbose else findings[:most]
    for number, each in enumerate(shown, 1):
        lines += ["", *_finding(number, each)]
    hidden = len(findings) - len(shown)
    if hidden:
        more = Message("and {findings}: --verbose", findings=counted(hidden, "finding"))
        lines.append(f"[dim]{' ' * NUMBER}{escape(translated(more))}[/]")
    if left_out:
        words = Message("{findings} left out: --select all", findings=counted(left_out, "finding"))
        lines += ["", f"[dim]{escape(translated(words))}[/]"]
    return lines


def _finding(number: int, finding: Finding) -> list[str]:
    text = finding.said
    if finding.bodies > 1:
        others = counted(finding.bodies - 1, "other body", "other bodies")
        text = Message("{text}; the same holds for {others}", text=text, others=others)
    style = "bold red" if finding.level == "broken" else "bold"
    room = columns() - NUMBER
    message = wrapped(translated(text), room)
    advice = [] if finding.advice is None else wrapped(translated(finding.advice), room)
    first, *rest = message
    # Alone on its line, as linters write it: terminals and editors open that.
    lines = [f"[cyan]{escape(finding.site)}[/]"] if finding.site else []
    lines += [f"[{style}]{left(str(number), NUMBER)}[/][{style}]{escape(first)}[/]"]
    lines += [f"{' ' * NUMBER}{escape(line)}" for line in rest]
    lines += [f"{' ' * NUMBER}[green]{escape(line)}[/]" for line in advice]
    code = f"[dim]{finding.code}[/]"
    space = room - columns_of((advice or message)[-1]) - columns_of(finding.code)
    if space < GAP:
        return [*lines, f"{' ' * NUMBER}{code}"]
    return [*lines[:-1], f"{lines[-1]}{' ' * space}{code}"]

"""A report: the result of a verb, as data that any renderer can show.

A report is made by the builder of its verb, a pure function of the verb's result. It contains text
in English (`Message`), numbers already written with their units, and the order in which a reader
wants them. The width of lines, the colours of words and the language are the renderer's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from drop_physics.figures.plot import Plot
    from drop_physics.messages import Message
    from drop_physics.rules.answer import Finding

Style = Literal["", "bold", "dim", "red", "yellow"]


@dataclass(frozen=True)
class Words:
    """A paragraph."""

    text: str
    style: Style = ""
    key: str = ""
    """Part of the text to be emphasised."""
    indent: str = ""
    """Indent of each line but the first."""
    margin: str = ""
    """Indent of each line."""


@dataclass(frozen=True)
class Fact:
    """A title, and words beside it."""

    title: str
    words: str
    style: Style = ""
    """Style of the title."""
    is_command: bool = False
    """Whether the words are a command to be pasted into a shell."""
    at_s: float | None = None
    """Simulated time of the moment that it tells [s]; renderers link to it."""


@dataclass(frozen=True)
class File:
    """A written file."""

    title: str
    path: Path | str
    facts: str = ""


@dataclass(frozen=True)
class Facts:
    """Titles in a column, with words or files beside them."""

    rows: Sequence[Fact | File]
    column: int = 0
    """Width of the titles in characters; 0 for the longest title and a gap."""


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, and a cell per row."""

    head: str
    cells: Sequence[str]
    right: bool = False
    """Whether cells are aligned to the right, as numbers are."""
    least: int = 0
    """Least width in characters."""
    most: int = 0
    """Width beyond which a cell is cut; 0 for none."""
    shrinks_to: int = 0
    """Width to which it may be cut if there is no room; 0 for none."""
    drop: int = 0
    """Columns with a number are left out if there is no room, the largest number first."""
    gap: int = 2
    """Gap before it in characters, unless it is the first."""
    style: Style = ""
    """Style of its cells."""
    wraps: bool = False
    """Whether a long cell continues in further lines; only for the last column."""
    fits: bool = False
    """Whether a cell is left out if there is no room for it; only for the last columns."""


def numbers(head: str, cells: Sequence[str], *, drop: int = 0) -> Column:
    """Return a column of numbers."""
    return Column(head, cells, right=True, least=8, drop=drop)


@dataclass(frozen=True)
class DataTable:
    """Columns of equal length."""

    columns: Sequence[Column]
    title: str = ""
    """Replaces the first column's head."""
    has_heads: bool = True
    has_total: bool = False
    """Whether the last row is the sum of the others."""
    failed: Sequence[bool] = ()
    """Whether something failed in each row; rows beyond its end did not fail."""
    left_out: Callable[[str], Words] | None = None
    """Returns a sentence about the columns left out for want of room, given their heads."""
    margin: str = ""
    """Indent of each line."""


@dataclass(frozen=True)
class FindingList:
    """Findings, the gravest first, with their sites and the calls that change them."""

    findings: Sequence[Finding]
    most: int
    """Number of findings to show."""
    left_out: int = 0
    """Number of further findings that were left out by choice."""
    sources: Mapping[str, Path] = field(default_factory=dict)
    """The files that they cite, if they are found."""
    first: int = 1
    """Number of the first finding."""
    looked_at: Message | None = None
    """Remark on what was examined, for a reader who sees no finding: silence is no verdict."""


def lines_of(finding: Finding, sources: Mapping[str, Path], around: int = 0) -> dict[int, str]:
    """Return the line of a script that a finding cites, and those around it, by number."""
    name, _, line = (finding.site or "").rpartition(":")
    if name not in sources or not line.isdecimal():
        return {}
    try:
        lines = sources[name].read_text(encoding="utf-8", errors="replace").split("\n")
    except OSError:
        return {}
    first = max(1, int(line) - around)
    return dict(enumerate(lines[first - 1 : int(line) + around], first))


@dataclass(frozen=True)
class Failure:
    """The error that ended a script, and its line."""

    finding: Finding
    sources: Mapping[str, Path]
    """The files that it cites, if they are found."""


@dataclass(frozen=True)
class Graphs:
    """Curves over time, made when a renderer draws them."""

    plot: Callable[[], Plot]


Block = Words | Facts | DataTable | FindingList | Graphs


@dataclass(frozen=True)
class Section:
    """Blocks that belong together."""

    blocks: Sequence[Block]
    apart: bool = True
    """Whether it is set apart from what precedes it."""


@dataclass(frozen=True)
class Report:
    """The report of a verb."""

    title: str = ""
    """Subject of the report among others: a command."""
    error: Failure | None = None
    """The error that a script ended with: it precedes all else."""
    verdict: Words | Fact | None = None
    """The first words."""
    sections: Sequence[Section] = ()
    notes: Sequence[str] = ()
    """Remarks on the result as a whole, for example that it is incomplete."""
    remarks: Sequence[str] = ()
    """The reason why it is not a success, shown at the end."""
    next: Sequence[str] = ()
    """Commands to type next, shown at the end."""
    code: int = 0
    """The exit code of the command."""

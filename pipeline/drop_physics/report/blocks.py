"""The data of a report: paragraphs, tables and curves, as any renderer can show them.

The builder of a verb's report is a pure function of the verb's result. A report contains English
text (`Message`), numbers formatted with their units, and the order in which to read them. The
renderer chooses line width, colours and language.
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
    """A paragraph of text."""

    text: str
    style: Style = ""
    key: str = ""
    """Part of the text that is emphasized."""
    indent: str = ""
    """Indent of every line but the first."""
    margin: str = ""
    """Indent of every line."""


@dataclass(frozen=True)
class Fact:
    """A title with a text beside it."""

    title: str
    words: str
    style: Style = ""
    """Style of the title."""
    is_command: bool = False
    """Whether the text is a command that can be pasted into a shell."""
    at_s: float | None = None
    """Simulated time of the moment that the text describes [s]; renderers link to it."""


@dataclass(frozen=True)
class File:
    """A file that was written."""

    title: str
    path: Path | str
    facts: str = ""


@dataclass(frozen=True)
class Facts:
    """Titles in a column, with texts or files beside them."""

    rows: Sequence[Fact | File]
    column: int = 0
    """Width of the column of titles in characters; 0 for the width of the longest title plus a
    gap."""


@dataclass(frozen=True)
class Column:
    """A column of a table: a heading, and a cell per row."""

    head: str
    cells: Sequence[str]
    right: bool = False
    """Whether cells are aligned to the right, as numbers are."""
    least: int = 0
    """Minimum width in characters."""
    most: int = 0
    """Width beyond which cells are truncated; 0 for no limit."""
    shrinks_to: int = 0
    """Width to which cells may be truncated if room is short; 0 for none."""
    drop: int = 0
    """Order of removal if room is short: the column with the largest number is removed first,
    columns with 0 never."""
    gap: int = 2
    """Gap before the column in characters, unless it is the first."""
    style: Style = ""
    """Style of the column's cells."""
    wraps: bool = False
    """Whether long cells are wrapped onto further lines; only allowed for the last column."""
    fits: bool = False
    """Whether cells without room are left out one by one; only allowed for the last columns."""


def numbers(head: str, cells: Sequence[str], *, drop: int = 0) -> Column:
    """Return a right-aligned column of numbers."""
    return Column(head, cells, right=True, least=8, drop=drop)


@dataclass(frozen=True)
class DataTable:
    """A table: columns of equal length."""

    columns: Sequence[Column]
    title: str = ""
    """Text shown in place of the first column's heading."""
    has_heads: bool = True
    has_total: bool = False
    """Whether the last row is the sum of the others."""
    failed: Sequence[bool] = ()
    """Whether each row represents a failure; missing entries mean no."""
    left_out: Callable[[str], Words] | None = None
    """Function that returns a sentence about columns removed for lack of room, given their
    headings."""
    margin: str = ""
    """Indent of each line."""


@dataclass(frozen=True)
class FindingList:
    """Findings, most severe first, with their call sites and suggested calls."""

    findings: Sequence[Finding]
    most: int
    """Maximum number of findings to show."""
    left_out: int = 0
    """Number of findings suppressed by options, comments or settings."""
    sources: Mapping[str, Path] = field(default_factory=dict)
    """Paths of the source files that findings cite, where they are found."""
    first: int = 1
    """Number given to the first finding."""
    looked_at: Message | None = None
    """Note on what was examined, shown if there are no findings, since their absence proves
    nothing."""


def lines_of(finding: Finding, sources: Mapping[str, Path], around: int = 0) -> dict[int, str]:
    """Return the source lines around the one that a finding cites, by line number."""
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
    """The error that ended a script, and the line that raised it."""

    finding: Finding
    sources: Mapping[str, Path]
    """Paths of the source files that the error cites, where they are found."""


@dataclass(frozen=True)
class Graphs:
    """Curves over time, drawn only by renderers that can show them."""

    plot: Callable[[], Plot]


Block = Words | Facts | DataTable | FindingList | Graphs


@dataclass(frozen=True)
class Section:
    """A group of related blocks."""

    blocks: Sequence[Block]
    apart: bool = True
    """Whether there is a gap before the section."""


@dataclass(frozen=True)
class Report:
    """The report of a command: title, verdict, sections, and commands to run next."""

    title: str = ""
    """Heading of the report among several ones: the command that it belongs to."""
    error: Failure | None = None
    """The error that ended the script, shown before everything else."""
    verdict: Words | Fact | None = None
    """The opening sentence: the main result."""
    sections: Sequence[Section] = ()
    notes: Sequence[str] = ()
    """Notes on the whole result, for example that the result is incomplete."""
    remarks: Sequence[str] = ()
    """Reasons why the result is not a success, shown at the end."""
    next: Sequence[str] = ()
    """Suggested next commands, shown at the end."""
    code: int = 0
    """Exit code of the command."""

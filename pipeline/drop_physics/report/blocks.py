"""A report: what a verb found, as data that any renderer can show.

A report is made by the builder of its verb, a pure function of the verb's result. What is in it is
text in English (`Message`), numbers already written with their units, and the order in which a
reader wants them. How wide a line is, which colour a word has, and in which language it is shown is
the renderer's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from drop_physics.figures.plot import Plot
    from drop_physics.rules.answer import Finding

Style = Literal["", "bold", "dim", "red", "yellow"]


@dataclass(frozen=True)
class Words:
    """A paragraph."""

    text: str
    style: Style = ""
    key: str = ""
    """A part of the text that stands out."""
    indent: str = ""
    """Before each line but the first."""
    margin: str = ""
    """Before each line."""


@dataclass(frozen=True)
class Fact:
    """A title, and words beside it."""

    title: str
    words: str
    style: Style = ""
    """Style of the title."""
    is_command: bool = False
    """Whether the words are to be pasted into a shell."""


@dataclass(frozen=True)
class File:
    """A file that was written."""

    title: str
    path: Path | str
    facts: str = ""


@dataclass(frozen=True)
class Facts:
    """Titles in a column, with words or files beside them."""

    rows: Sequence[Fact | File]
    column: int = 0
    """Characters that the titles take; 0 for as many as the longest, and a gap."""


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, and a cell per row."""

    head: str
    cells: Sequence[str]
    right: bool = False
    """Whether cells are aligned to the right, as numbers are."""
    least: int = 0
    """Characters that it takes at least."""
    most: int = 0
    """Characters after which a cell is cut; 0 for none."""
    shrinks_to: int = 0
    """Characters that it may be cut to where there is no room; 0 for none."""
    drop: int = 0
    """Columns with a number are left out where there is no room, the largest number first."""
    gap: int = 2
    """Characters before it, where it is not the first."""
    style: Style = ""
    """Style of its cells."""
    wraps: bool = False
    """Whether a long cell goes on in further lines; of the last column only."""
    fits: bool = False
    """Whether a cell is left out where there is no room for it; of the last columns only."""


def numbers(head: str, cells: Sequence[str], *, drop: int = 0) -> Column:
    """Return a column of numbers."""
    return Column(head, cells, right=True, least=8, drop=drop)


@dataclass(frozen=True)
class DataTable:
    """Columns of equal length."""

    columns: Sequence[Column]
    title: str = ""
    """What stands in place of the first column's head."""
    has_heads: bool = True
    has_total: bool = False
    """Whether the last row is the sum of the others."""
    failed: Sequence[bool] = ()
    """The rows in which something failed; none of those beyond its end."""
    left_out: Callable[[str], Words] | None = None
    """Says which columns are left out for want of room, given their heads."""
    margin: str = ""
    """Before each line."""


@dataclass(frozen=True)
class FindingList:
    """Findings, the gravest first, each with its site and what changes it."""

    findings: Sequence[Finding]
    most: int
    """How many are shown."""
    left_out: int = 0
    """How many more were found, and left out by choice."""
    sources: Mapping[str, Path] = field(default_factory=dict)
    """The files that they cite, where these are found."""
    first: int = 1
    """The number of the first."""


@dataclass(frozen=True)
class Graphs:
    """Curves over time, which are made when a renderer draws them."""

    plot: Callable[[], Plot]


Block = Words | Facts | DataTable | FindingList | Graphs


@dataclass(frozen=True)
class Section:
    """Blocks that belong together."""

    blocks: Sequence[Block]
    apart: bool = True
    """Whether it stands apart from what is before it."""


@dataclass(frozen=True)
class Report:
    """What a verb found."""

    title: str = ""
    """What it is of, where it stands among others: a command."""
    verdict: Words | Fact | None = None
    """What there is to say first."""
    sections: Sequence[Section] = ()
    notes: Sequence[str] = ()
    """What is worth knowing about the result as a whole, such as that it is incomplete."""
    remarks: Sequence[str] = ()
    """What is said after it: why it is no success."""
    code: int = 0
    """The exit code of the command."""

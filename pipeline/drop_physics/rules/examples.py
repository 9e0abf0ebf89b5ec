"""Reads the examples of codes from `docs/why.md`: scripts, with drop's output.

In a wheel, that page is installed beside this file; in a clone, it is read from `docs`.
"""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from pathlib import Path

from drop_physics.rules.codes import CODES

INDENT, WIDTH = 3, 80
"""Columns before the text of a finding, and width of a line of the page."""
ADVICE = "p.", "to try: "
"""Prefixes by which a line is recognized as advice if the message's last line is full."""
PAGE = "why.md"
IN_A_CLONE = Path(__file__).parents[3] / "docs" / PAGE
SECTION = re.compile(r"^### (.+?)\n(.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)
ANSWER = re.compile(r"\$ drop analyze recordings/(\w+)\.rrd\n(.*?)```", re.DOTALL)
FINDING = re.compile(r"(?:^(\S+):(\d+)\n)?^\d  (.*?)(?=^…|\Z)", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class CodeExample:
    """A script in the documentation that produces a finding, and that finding."""

    asked: str
    """The question that its user asked."""
    script: str
    """Path of the script, from the root of the repository."""
    line: int | None
    """The line that a finding cites; null if it cites none."""
    says: str
    """The message of the finding."""
    advises: str | None
    """The advice of the finding; null if it has none."""


def examples() -> dict[str, CodeExample]:
    """Return the examples of codes and reasons, by code or reason."""
    page = Path(__file__).with_name(PAGE)
    text = (page if page.exists() else IN_A_CLONE).read_text(encoding="utf-8")
    found: dict[str, CodeExample] = {}
    for asked, section in SECTION.findall(text):
        for name, shown in ANSWER.findall(section):
            for script, line, words in FINDING.findall(shown):
                texts, code = _texts(words.split("\n")), name.replace("_", "-")
                said, _, last = texts[-1].rpartition(" ")
                if last in CODES:
                    texts[-1], code = said.strip(), last
                else:  # what a page shows of it ends before
                    texts[-1] += " …"
                says, *advises = texts
                where = script or f"docs/examples/why/{name}.py"
                cited = int(line) if line else None
                example = CodeExample(asked, where, cited, says, " ".join(advises).strip() or None)
                found.setdefault(code, example)
    return found


def _texts(lines: list[str]) -> list[str]:
    """Split lines of output into message and advice, after the first line that ends early.

    A line before a long call also ends early, since calls are not wrapped.
    """
    texts = [""]
    for line, following in itertools.pairwise([*filter(None, map(str.strip, lines)), ""]):
        texts[-1] = f"{texts[-1]} {line}".strip()
        word = following.partition(" ")[0]
        ends = INDENT + len(f"{line} {word}") <= WIDTH
        if following and (ends or following.startswith(ADVICE)):
            texts.append("")
    return texts

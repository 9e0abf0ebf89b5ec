"""Write the codes of findings: their table in `why.md`, and what `drop explain` says of each.

Both are read from what cannot go stale: the rules, and for examples the answers that the pages
show, which the tests compare with what `drop` prints.
"""

from __future__ import annotations

import itertools
import json
import re

from drop_physics.rules.codes import CODES
from drop_physics.rules.reference import FILE, CodeReference, reference_from

from generators.rule_texts import gathered
from generators.typed import ROOT

DOCS = ROOT / "docs"
BEGIN, END = "<!-- codes: made by docs/regenerate.py -->\n", "<!-- codes end -->\n"
TRIED = " *To try.*"
"""What is said of a code whose rules only propose what changes it."""
INDENT, WIDTH = 3, 80
"""Columns before the text of a finding, and of a line."""
SECTION = re.compile(r"^### (.+?)\n(.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)
ANSWER = re.compile(r"\$ drop analyze recordings/(\w+)\.rrd\n(.*?)```", re.DOTALL)
FINDING = re.compile(r"(?:^(\S+):(\d+)\n)?^\d  (.*?)(?=^…|\Z)", re.MULTILINE | re.DOTALL)


def made() -> dict[str, str]:
    """Return the page with its table, and the file of what is said of codes, by their names."""
    page = (DOCS / "why.md").read_text(encoding="utf-8")
    head, rest = page.split(BEGIN)
    texts = gathered()
    codes = {name: reference_from(name, each) for name, each in texts.items()}
    rows = [
        f"| `{each.code}` | {each.level or ''} | {each.meaning}{TRIED * _proposes(each)} |"
        for each in codes.values()
        if each.reason_of is None
    ]
    table = "\n".join(
        ["", "| code | level | what it means |", "| --- | --- | --- |", *rows, "", ""]
    )
    examples = _examples(page, codes)
    held = {name: {**each, "example": examples.get(name)} for name, each in texts.items()}
    file = f"../pipeline/drop_physics/rules/{FILE}"
    return {
        "why.md": f"{head}{BEGIN}{table}{END}{rest.split(END)[1]}",
        file: f"{json.dumps(held, indent=1, ensure_ascii=False)}\n",
    }


def _proposes(code: CodeReference) -> bool:
    return bool(code.proposes) or any(proposed for _, _, proposed in code.cures)


def _examples(page: str, codes: dict[str, CodeReference]) -> dict[str, dict[str, str | None]]:
    """Return by code what is asked, which line of which script shows it, and what `drop` says."""
    found: dict[str, dict[str, str | None]] = {}
    for asked, text in SECTION.findall(page):
        for name, shown in ANSWER.findall(text):
            for script, line, words in FINDING.findall(shown):
                texts, code = _texts(words.split("\n")), name.replace("_", "-")
                said, _, last = texts[-1].rpartition(" ")
                if last in CODES:
                    texts[-1], code = said.strip(), last
                else:  # what a page shows of it ends before
                    texts[-1] += " …"
                says, advises = texts[0], " ".join(texts[1:]).strip() or None
                if advises is None:
                    says, advises = _parted(says.strip(), codes[code])
                lines = (ROOT / script).read_text(encoding="utf-8").split("\n") if script else []
                found.setdefault(
                    code,
                    {
                        "asked": asked,
                        "script": script or f"docs/examples/why/{name}.py",
                        "line": lines[int(line) - 1].strip() if script else None,
                        "says": says,
                        "advises": advises,
                    },
                )
    return found


def _texts(lines: list[str]) -> list[str]:
    """Return message and advice: a line that ends although the next word would fit ends a text."""
    texts = [""]
    for line, following in itertools.pairwise([*filter(None, map(str.strip, lines)), ""]):
        texts[-1] = f"{texts[-1]} {line}".strip()
        word = following.partition(" ")[0]
        if following and INDENT + len(f"{line} {word}") <= WIDTH:
            texts.append("")
    return texts


def _parted(text: str, code: CodeReference) -> tuple[str, str | None]:
    """Return message and advice where the lines do not show it: it is one of those of its code."""
    advises = [each for each in [*code.advises, *code.proposes] if not each.startswith("…")]
    forms = (".+".join(map(re.escape, each.split("…"))) for each in advises)
    for form in (*forms, r"p\.\w+\(…, .*"):
        if found := re.search(f" ((?:to try: )?{form})$", text):
            return text[: found.start()], found[1]
    return text, None

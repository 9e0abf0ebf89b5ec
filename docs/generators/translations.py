"""Update the Japanese message catalogue from the messages in the code.

The translations in `drop.po` are written by hand. What waits for one is shown in English.
"""

from __future__ import annotations

import ast
import io
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from babel.messages.catalog import Catalog
from babel.messages.pofile import read_po, write_po
from drop_physics.drop.findings import ALL_RULES
from drop_physics.rules.reference import sentences

from generators.typed import ROOT

PACKAGE = ROOT / "pipeline/drop_physics"
MESSAGES = PACKAGE / "locale/ja/LC_MESSAGES/drop.po"
TEMPLATES = dict.fromkeys(
    (
        "Message",
        "joined",
        "localized",
        "label",
        "DropError",
        "ScenarioError",
        "RecordingError",
        "OutputError",
        "ForeignError",
        "ViewerError",
        "StreamError",
        "WorkerDiedError",
    ),
    0,
) | {"counted": 1}
"""Functions that take a template, and the index of that argument; the first if none is given."""


class Translations(Catalog):
    """Japanese messages; the file's header has neither a date nor a generator."""

    mime_headers: ClassVar[list[tuple[str, str]]] = [  # type: ignore[misc]
        ("Language", "ja"),
        ("MIME-Version", "1.0"),
        ("Content-Type", "text/plain; charset=utf-8"),
        ("Content-Transfer-Encoding", "8bit"),
    ]

    def __init__(self) -> None:
        comment = "# Japanese messages of drop. Write the msgstr lines, then: docs/regenerate.py"
        super().__init__("ja", header_comment=comment, fuzzy=False)


def templates() -> Iterator[tuple[str, str]]:
    """Yield the package's message templates, each with the file that contains it.

    Found in the syntax tree: which strings Babel's own extraction finds depends on its version.
    """
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(
                    func=ast.Name(id=name) | ast.Attribute(attr=name), args=arguments
                ) if name in TEMPLATES:
                    match arguments[TEMPLATES[name] :]:
                        case [ast.Constant(value=str(text)), *_]:
                            yield text, path.relative_to(PACKAGE).as_posix()
    for text in sentences(ALL_RULES):
        yield text, "rules/reference.py"


def made() -> dict[Path, bytes]:
    """Return the catalogue of the code's messages with translations; new messages have none yet."""
    translations, template = Translations(), Catalog(fuzzy=False)
    with MESSAGES.open(encoding="utf-8") as file:
        for known in read_po(file):
            if known.id:
                translations[known.id] = known
    for text, path in templates():
        template.add(text, locations=[(path, None)])
    translations.update(template, no_fuzzy_matching=True)
    text = io.BytesIO()
    write_po(text, translations, sort_output=True, ignore_obsolete=True)
    return {MESSAGES: text.getvalue()}


def compiled() -> None:
    """Compile each translation source that is newer than its compiled file."""
    target = MESSAGES.with_suffix(".mo")
    if not target.exists() or target.stat().st_mtime < MESSAGES.stat().st_mtime:
        build = runpy.run_path(str(ROOT / "hatch_build.py"))
        build["compile_messages"](MESSAGES, target)

"""Bring the Japanese messages up to what the code says, and compile them.

The translations in `drop.po` are written by hand; `drop.mo` is what the program reads.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import ClassVar

from babel.messages.catalog import Catalog
from babel.messages.extract import extract_from_dir
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po

from generators.typed import ROOT

MESSAGES = ROOT / "pipeline/drop_physics/locale/ja/LC_MESSAGES/drop.po"
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
    )
) | {"counted": (2,)}
"""What takes a template, and as which of its arguments; the first where none is named."""


class Translations(Catalog):
    """Japanese messages, whose head says neither when nor with what they were written."""

    mime_headers: ClassVar[list[tuple[str, str]]] = [  # type: ignore[misc]
        ("Language", "ja"),
        ("MIME-Version", "1.0"),
        ("Content-Type", "text/plain; charset=utf-8"),
        ("Content-Transfer-Encoding", "8bit"),
    ]

    def __init__(self) -> None:
        comment = "# Japanese messages of drop. Write the msgstr lines, then: docs/regenerate.py"
        super().__init__("ja", header_comment=comment, fuzzy=False)


def made() -> dict[Path, bytes]:
    """Return the messages of the code with their translations, and the same compiled.

    A new message has no translation, or that of a similar one, marked as fuzzy; neither is
    compiled.
    """
    translations, template = Translations(), Catalog(fuzzy=False)
    with MESSAGES.open(encoding="utf-8") as file:
        for known in read_po(file):
            if known.id:
                translations[known.id] = known
    for name, _, text, *_ in extract_from_dir(ROOT / "pipeline/drop_physics", keywords=TEMPLATES):
        template.add(text, locations=[(name, None)])
    translations.update(template)
    text, compiled = io.BytesIO(), io.BytesIO()
    write_po(text, translations, sort_output=True, ignore_obsolete=True)
    write_mo(compiled, translations)
    return {MESSAGES: text.getvalue(), MESSAGES.with_suffix(".mo"): compiled.getvalue()}

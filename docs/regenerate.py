"""Regenerate the generated parts of the documents: `python docs/regenerate.py [PAGE.md …]`.

The outputs and pictures that pages show are those of their commands; the references are written
from the code. `tests/test_pages.py` and `tests/test_references.py` fail where one is stale. The
picture of the viewer is made only when it is asked for: `python docs/regenerate.py viewer.png`.
`drop.po`, the Japanese messages, gets those that are new: translate them there, and run it again.
"""

from __future__ import annotations

import sys
from pathlib import Path

from generators import (
    commands,
    json_objects,
    pages,
    readme,
    recording,
    translations,
    typed,
    validation,
)
from generators.pictures import alike


def references() -> dict[Path, bytes]:
    """Return the reference pages generated from the current code."""
    texts = commands.made() | recording.made() | json_objects.made()
    return {(pages.DOCS / name).resolve(): text.encode() for name, text in texts.items()}


def is_current(path: Path, content: bytes) -> bool:
    """Whether a file is up to date; images may differ invisibly."""
    if not path.exists():
        return False
    known = path.read_bytes()
    if known == content or path.suffix not in (".png", ".gif", ".webp"):
        return known == content
    return alike(known, content)


def main(names: list[str]) -> None:
    """Update and list the files that are out of date; only the named pages, if any are named."""
    if not names or "validation.md" in names:
        write({pages.DOCS / name: text.encode() for name, text in validation.made().items()})
    if not names or "README.md" in names:
        write(readme.made())
    if not names or "drop.po" in names:
        write(translations.made())
    translations.compiled()  # for the Japanese pages
    if readme.VIEWER.name in names:
        write(readme.viewer_picture())
    for page in pages.pages():
        if not names or page.name in names:
            write(pages.played(page))
    write(references())  # among them what is read from the pages


def write(made: dict[Path, bytes]) -> None:
    """Write the files that are out of date."""
    for path, content in made.items():
        if not is_current(path, content):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            print(path.relative_to(typed.ROOT))


if __name__ == "__main__":
    main([Path(name).name for name in sys.argv[1:]])

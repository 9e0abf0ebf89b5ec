"""Make what is generated in these documents anew: `python docs/regenerate.py`.

The walkthrough's outputs and pictures are those of its commands; the references are written from
the code. `tests/test_walkthrough.py` and `tests/test_references.py` fail where one has become old.
"""

from __future__ import annotations

from pathlib import Path

from generators import commands, json_objects, recording, walkthrough


def references() -> dict[Path, bytes]:
    """Return the references as the code has them now."""
    texts = commands.made() | recording.made() | json_objects.made()
    return {walkthrough.DOCS / name: text.encode() for name, text in texts.items()}


def is_current(path: Path, content: bytes) -> bool:
    """Whether a file says what it should; pictures may differ by what nobody sees."""
    if not path.exists():
        return False
    known = path.read_bytes()
    if known == content or path.suffix not in (".png", ".gif", ".webp"):
        return known == content
    return walkthrough.alike(known, content)


def main() -> None:
    """Write what is no longer current, and say so."""
    for path, content in {**references(), **walkthrough.made()}.items():
        if not is_current(path, content):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            print(path.relative_to(walkthrough.DOCS))


if __name__ == "__main__":
    main()

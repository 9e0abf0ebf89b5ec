"""Finds the source files of a recorded script, and checks that their text has not changed.

A comment `# drop: ignore[CODE]` on the first line of a call suppresses a finding.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import re
import tokenize
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from drop_physics.recording.reader import Recording

COMMENT = re.compile(r"#\s*drop:\s*ignore\[([^\]]*)\]")

Lines = Mapping[int, frozenset[str]]
"""The finding codes named in `ignore` comments, by line number."""


class Sources:
    """The source files of a script, verified against the digest in the recording.

    Parameters
    ----------
    digest
        The digest of the script's recorded text; None if no text was recorded, as for a `with`
        block.
    folders
        The folders to which file names in findings may be relative.
    """

    def __init__(self, digest: str | None, folders: Sequence[Path]) -> None:
        self._digest, self._folders = digest, folders
        self._lines: dict[str, Lines] = {}

    @classmethod
    def of(cls, held: Recording, script: Path | None) -> Sources:
        """Return the sources for a recording; `script` is the script's path, if known."""
        path = held.path
        folders = [Path(), path.parent, path.parent.parent, (script or Path()).parent]
        return cls(held.origin_and_end.get("script_sha256"), folders)

    def files(self, names: Iterable[str]) -> dict[str, Path]:
        """Return the paths of the files that were found, by the names used in call sites."""
        found = {name: self._file(name) for name in names}
        return {name: path for name, path in found.items() if path is not None}

    def ignored_at(self, site: str | None) -> frozenset[str]:
        """Return the codes that a comment on a line suppresses; the line is given as file:line."""
        name, _, line = (site or "").rpartition(":")
        if not line.isdecimal():
            return frozenset()
        if name not in self._lines:
            path = self._file(name)
            self._lines[name] = {} if path is None else comments_in(path.read_bytes())
        return self._lines[name].get(int(line), frozenset())

    def _file(self, name: str) -> Path | None:
        """Return the path of an unchanged source file; None if it is not found or has changed.

        File names in a recording are not trusted: a name that leads out of a folder is ignored, and
        pipes and devices are not opened.
        """
        inside = not Path(name).is_absolute() and ".." not in Path(name).parts
        for folder in self._folders if self._digest is not None and inside else ():
            path = folder / name
            with contextlib.suppress(OSError, ValueError):
                if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == self._digest:
                    return path
        return None


def comments_in(text: bytes) -> Lines:
    """Return the codes that comments of a Python file suppress, by line."""
    lines: dict[int, frozenset[str]] = {}
    with contextlib.suppress(tokenize.TokenError, SyntaxError):
        for token in tokenize.tokenize(io.BytesIO(text).readline):
            if token.type == tokenize.COMMENT and (found := COMMENT.search(token.string)):
                lines[token.start[0]] = frozenset(map(str.strip, found[1].split(",")))
    return lines

"""Findings that a script is spared: `# drop: ignore[CODE]` on the first line of a call.

The script is read only if its text is the recorded one, which its digest tells.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import re
import tokenize
from collections.abc import Mapping, Sequence
from pathlib import Path

COMMENT = re.compile(r"#\s*drop:\s*ignore\[([^\]]*)\]")

Lines = Mapping[int, frozenset[str]]
"""The codes of each line that has such a comment."""


class Ignored:
    """The codes that lines of a recorded script are spared.

    Parameters
    ----------
    digest
        Of its recorded text; None where it has none, as a block of Python.
    folders
        Where its name, as a finding has it, may lead to it.
    """

    def __init__(self, digest: str | None, folders: Sequence[Path]) -> None:
        self._digest, self._folders = digest, folders
        self._files: dict[str, Lines] = {}

    def at(self, site: str | None) -> frozenset[str]:
        """Return the codes of a site, given as file:line."""
        file, _, line = (site or "").rpartition(":")
        if self._digest is None or not line.isdecimal():
            return frozenset()
        if file not in self._files:
            self._files[file] = self._lines_of(file)
        return self._files[file].get(int(line), frozenset())

    def _lines_of(self, file: str) -> Lines:
        for folder in self._folders:
            with contextlib.suppress(OSError, ValueError):
                text = (folder / file).read_bytes()
                if hashlib.sha256(text).hexdigest() == self._digest:
                    return comments_in(text)
        return {}


def comments_in(text: bytes) -> Lines:
    """Return the codes in the comments of a Python file, by line."""
    lines: dict[int, frozenset[str]] = {}
    with contextlib.suppress(tokenize.TokenError, SyntaxError):
        for token in tokenize.tokenize(io.BytesIO(text).readline):
            if token.type == tokenize.COMMENT and (found := COMMENT.search(token.string)):
                lines[token.start[0]] = frozenset(map(str.strip, found[1].split(",")))
    return lines

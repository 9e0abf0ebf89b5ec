"""Finds the files that a user would edit: the script, its own modules, and models they load."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from drop_physics.stages.rerun.scratch import LEFT_OUT

MOST_BYTES = 1 << 24
"""Largest file that is read [bytes]."""
MOST_BELOW = 2000
"""Most files below a source file's folder that are searched for a model."""
NAMED = re.compile(rb"""["']([^"'\n]+\.(?:xml|mjcf|urdf|sdf))["']""")
"""Pattern of a model's path in a text."""


@dataclass(frozen=True)
class SourceText:
    """A file that the user may edit, with its text."""

    path: str
    """The file; empty for the script, whose text is replaced when it runs."""
    shown: str
    """The name of the file, as it is shown."""
    text: bytes


def source_texts(script: Path | None, modules: Iterable[Path]) -> list[SourceText]:
    """Return a script's own files: the script, modules near it, and models that they name.

    A model's path is resolved from the file that names it or from the working directory; failing
    that, a file with that name is searched below those folders.

    Parameters
    ----------
    script
        Path of the script; None if a module is run, which is then in `modules`.
    modules
        Files of the imported modules, and of the script.
    """
    own = None if script is None else script.resolve()
    folders = [Path.cwd(), *([] if own is None else [own.parent])]
    found = {} if own is None else {own: _read(own)}
    for path in modules:
        if any(map(path.is_relative_to, folders)):
            found.setdefault(path, _read(path))
    waiting = [*found]
    while waiting:
        path = waiting.pop(0)
        for model in _named_in(path, found[path]):
            if model not in found:
                found[model] = _read(model)
                waiting.append(model)
    return [
        SourceText("" if path == own else str(path), _shown(path, folders), text)
        for path, text in found.items()
    ]


def _named_in(path: Path, text: bytes) -> Iterator[Path]:
    """Yield the model files that a text names, if they are below the script's folders."""
    paths = {each.decode(errors="replace") for each in NAMED.findall(text)}
    within = dict.fromkeys((path.parent, Path.cwd()))
    names = {Path(each).name for each in paths}
    for each in [folder / each for folder in within for each in sorted(paths)]:
        if each.name in names and each.is_file():
            names.discard(each.name)
            yield each.resolve()
    for folder in within:
        left = MOST_BELOW if names else 0
        for at, folders, files in os.walk(folder):
            folders[:] = [each for each in folders if each not in LEFT_OUT and each[0] != "."]
            left -= len(files)
            if left < 0:
                break
            for name in sorted(names.intersection(files)):
                names.discard(name)
                yield Path(at, name).resolve()


def _shown(path: Path, folders: Iterable[Path]) -> str:
    """Return a file's path relative to the first of the given folders that contains it."""
    within = next(filter(path.is_relative_to, folders), path.parent)
    return str(path.relative_to(within))


def _read(path: Path) -> bytes:
    try:
        return b"" if path.stat().st_size > MOST_BYTES else path.read_bytes()
    except OSError:
        return b""

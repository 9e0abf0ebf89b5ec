"""Finds the file that a script meant when it failed to load one."""

from __future__ import annotations

import difflib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

from drop_physics.messages import Message

_FIRST = re.compile(r"^(?:fileName=)?'([^']+)'")
_MESH = re.compile(r"filename=[\"']([^\"']+)[\"']")
LARGEST_BYTES = 1 << 24
"""Largest file that is searched for references [bytes]."""
SEARCH = Message("p.setAdditionalSearchPath(pybullet_data.getDataPath())")


def missing_file(arguments: str, target: str) -> Message | None:
    """Return the place of a file that was not found, or its missing meshes; None if unknown.

    Parameters
    ----------
    arguments
        The source text of the call's arguments.
    target
        The script, which is assumed to run in this process's working directory.
    """
    named = _FIRST.match(arguments)
    if named is None:
        return None
    name, beside = Path(named[1]), Path(target).parent
    package = importlib.util.find_spec("pybullet_data")
    data = Path(package.origin).parent if package is not None and package.origin else None
    if name.is_file() or (data and (data / name).is_file() and not _complete(data / name)):
        found = name if name.is_file() or data is None else data / name
        lost = next(_lost_meshes(found), None)
        words = Message(
            "{name} exists, but {mesh}, which it names, does not", name=str(name), mesh=lost
        )
        return None if lost is None else words
    if (beside / name).is_file():
        return Message(
            "{name} is beside the script, but is looked for in the working directory: give {path}",
            name=str(name),
            path=str(beside / name),
        )
    if data and (data / name).is_file():
        return Message("{name} is in pybullet_data: call {search}", name=str(name), search=SEARCH)
    for folder in filter(None, (Path(), beside, data)):
        near = _near(folder / name)
        if near is not None:
            return Message(
                "There is no {name}, but there is {near}",
                name=str(name),
                near=str(near.relative_to(folder)),
            )
    return Message(
        "There is no {name} in the working directory, beside the script or in pybullet_data",
        name=str(name),
    )


def _complete(file: Path) -> bool:
    """Return whether all meshes that a model file refers to exist."""
    return next(_lost_meshes(file), None) is None


def _lost_meshes(file: Path) -> Iterator[str]:
    """Yield the meshes that a model file refers to but that are missing."""
    if file.stat().st_size > LARGEST_BYTES:
        return
    for mesh in _MESH.findall(file.read_text(errors="replace")):
        path = mesh.removeprefix("package://").removeprefix("file://")
        folders = (Path(), file.parent, *list(file.resolve().parents)[:3])
        if not any((folder / path).is_file() for folder in folders):
            yield mesh


def _near(path: Path) -> Path | None:
    """Return the file in the same folder with the most similar name; None if none is similar."""
    if not path.parent.is_dir():
        return None
    names = [each.name for each in path.parent.iterdir() if each.suffix == path.suffix]
    alike = {name.casefold(): name for name in names}
    found = difflib.get_close_matches(path.name.casefold(), alike, 1, 0.8)
    return path.with_name(alike[found[0]]) if found else None

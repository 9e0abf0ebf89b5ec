"""Counts the links in model files, since PyBullet hides links of models loaded as rigid bodies."""

from __future__ import annotations

import os
from collections.abc import Callable
from xml.parsers import expat

FOLDERS = (
    "",
    "./data/",
    "../data/",
    "../../data/",
    "../../../data/",
    "../../../../data/",
)
"""Folders in which PyBullet looks for a file (`b3BulletDefaultFileIO::findFile`)."""
MOST_BYTES = 10_000_000
"""Largest number of bytes that are read from a file."""

MODELS = {
    "loadURDF": (("robot",),),
    "loadSDF": (("sdf", "model"), ("sdf", "world", "model")),
    "loadMJCF": (("mujoco", "worldbody", "body"),),
}
"""XML elements that define a model, by the function that loads it: paths from the root element."""


def path_of(name: str, search_path: str) -> str | None:
    """Return the file that PyBullet opens for a name (`b3ResourcePath::findResourcePath`)."""
    names = [name, f"{search_path}/{name}"] if search_path else [name]
    paths = [folder + each for each in names for folder in FOLDERS]
    return next((path for path in paths if os.path.isfile(path)), None)


def links_in(path: str, call: str, *, merged: bool) -> list[int]:
    """Return the number of links of each model in a file.

    Parameters
    ----------
    path
        The path of the file.
    call
        The PyBullet function that loads the file.
    merged
        Whether links on fixed joints are merged with their parents, which only `loadURDF` can do.
    """
    models = MODELS[call]
    links: list[int] = []

    def start(within: tuple[str, ...], attributes: dict[str, str]) -> None:
        tag = within[-1]
        if within in models:
            links.append(int(call == "loadMJCF" or merged))
        elif within[:-1] in models and call != "loadMJCF":
            moves = tag == "joint" and attributes.get("type") != "fixed"
            links[-1] += moves if merged else tag == "link"
        elif call == "loadMJCF" and any(within[: len(model)] == model for model in models):
            # Each of its joints connects a link, but one that leaves it free.
            moves = tag == "joint" and attributes.get("type") != "free"
            links[-1] += tag == "body" or moves

    walk(path, start)
    return links


def walk(path: str, start: Callable[[tuple[str, ...], dict[str, str]], None]) -> bool:
    """Call a function for each XML element, with all tags from the root on, and its attributes.

    Returns whether the whole file could be read.
    """
    within: list[str] = []

    def enter(tag: str, attributes: dict[str, str]) -> None:
        within.append(tag)
        start(tuple(within), attributes)

    parser = expat.ParserCreate()
    parser.StartElementHandler = enter
    parser.EndElementHandler = lambda _: within.pop()
    with open(path, "rb") as file:
        text = file.read(MOST_BYTES)
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, LookupError, ValueError):  # also of its encoding
        return False
    return True

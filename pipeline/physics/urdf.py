"""Read a URDF before Bullet does, so far that Bullet cannot come to grief over it.

Bullet's importer trusts what it is given: a second root link or a name of some thousand letters
ends the process with a segmentation fault, `nan` becomes a length, and a word becomes 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as Xml

from pipeline.errors import ScenarioError

MOST_BYTES = 10_000_000
LONGEST_VALUE = 1000
"""Characters in one attribute; Bullet copies names into arrays on its stack."""
LARGEST = 1e9
"""Of a mass [kg], a length [m] or an inertia: what Bullet's doubles still square and add."""

# Element -> its attributes that are numbers: how many, and whether all must be above zero.
NUMBERS: dict[str, dict[str, tuple[int, bool]]] = {
    "mass": {"value": (1, False)},
    "inertia": {f"i{axes}": (1, False) for axes in ("xx", "xy", "xz", "yy", "yz", "zz")},
    "origin": {"xyz": (3, False), "rpy": (3, False)},
    "box": {"size": (3, True)},
    "sphere": {"radius": (1, True)},
    "cylinder": {"radius": (1, True), "length": (1, True)},
    "capsule": {"radius": (1, True), "length": (1, True)},
}


def check_urdf(path: Path) -> None:
    """Make sure that Bullet can be given a URDF.

    Raises
    ------
    ScenarioError
        If it is no well-formed XML, not one tree of links, or a number in it is none.
    """
    for problem in _problems(path):
        raise ScenarioError(f"--body must be a URDF that Bullet can load, got {path}: {problem}")


def _problems(path: Path) -> Iterator[str]:
    if path.stat().st_size > MOST_BYTES:
        yield f"it has more than {MOST_BYTES:,} bytes"
    data = path.read_bytes()
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        yield "it declares a document type, which a URDF needs not"
    try:
        robot = Xml.fromstring(data)
    except (Xml.ParseError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        yield f"it is no well-formed XML ({error})"
        return
    if robot.tag != "robot":
        yield f"its root is <{robot.tag[:40]}>, not <robot>"
    yield from _tree_problems(robot)
    for element in robot.iter():
        for name, value in element.attrib.items():
            if len(value) > LONGEST_VALUE:
                yield f"its {name} of <{element.tag[:40]}> has {len(value):,} letters"
        for name, (count, positive) in NUMBERS.get(element.tag, {}).items():
            if (text := element.get(name)) is not None:
                yield from _number_problems(f"{name} of <{element.tag}>", text, count, positive)


def _tree_problems(robot: Xml.Element) -> Iterator[str]:
    links = [link.get("name", "") for link in robot.findall("link")]
    if len(set(links)) != len(links):
        yield "two of its links have one name"
    parent_of = {
        _end(joint, "child"): _end(joint, "parent") for joint in robot.findall("joint")
    }  # a link that two joints lead to loses one here, and its tree then
    roots = [link for link in links if link not in parent_of]
    if len(roots) != 1 or len(parent_of) != len(robot.findall("joint")):
        yield f"its links must be one tree, and {len(roots)} of them hang on no joint"
    reached = set(roots)
    while more := {one for one, parent in parent_of.items() if parent in reached} - reached:
        reached |= more
    if reached != set(links):
        yield "its joints do not lead from one link to all others"


def _end(joint: Xml.Element, name: str) -> str:
    end = joint.find(name)
    return "" if end is None else end.get("link", "")


def _number_problems(name: str, text: str, count: int, positive: bool) -> Iterator[str]:
    try:
        numbers = [float(part) for part in text.split()]
    except ValueError:
        numbers = [math.nan]
    if len(numbers) != count or not all(math.isfinite(one) for one in numbers):
        yield f"{name} must be {count} finite numbers, got {text[:40]!r}"
    elif max(map(abs, numbers)) > LARGEST or (positive and min(numbers) <= 0):
        above = "above 0 and " if positive else ""
        yield f"{name} must be {above}at most {LARGEST:g}, got {text[:40]!r}"

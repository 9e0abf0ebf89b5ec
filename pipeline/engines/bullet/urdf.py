"""Read a URDF before Bullet does, so far that Bullet cannot come to grief over it.

Bullet's importer trusts what it is given: a second root link or a name of some thousand letters
ends the process with a segmentation fault, `nan` becomes a length, and a word becomes 0. What
cannot be told from the text alone is tried out (`probe`).
"""

from __future__ import annotations

import math
import os
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as Xml
from xml.parsers import expat

from pipeline.engines.bullet.body_files import NUMBER, BodyFileError, cut_lines, files_behind, read
from pipeline.errors import ScenarioError

MOST_BYTES = 10_000_000
LONGEST_VALUE = 1000
"""Characters in one attribute; Bullet copies names into arrays on its stack."""
LONGEST_LINE = 8190
"""Bytes: Bullet reads lines of 8,191, their end included, and breaks longer ones, numbers too."""
LARGEST = 1e9
"""Of a mass [kg], a length [m] or an inertia: what Bullet's doubles still square and add."""
MOST_JOINTS = 127
"""With the base MAX_DEGREE_OF_FREEDOM = 128 links (bullet3's `SharedMemoryCommands.h`); with more
PyBullet reads no pose."""
MOST_POSITIONS = 121
"""Coordinates of all joints: with the base's 7 they fill an array of 128, and the velocities that
PyBullet reads lie behind it."""
POSITIONS = {"revolute": 1, "continuous": 1, "prismatic": 1, "planar": 3, "spherical": 4}


class Numbers(NamedTuple):
    """What an attribute must hold."""

    counts: tuple[int, ...] = (1,)
    """How many numbers there may be."""
    largest: float = math.inf
    above_zero: bool = False


_ONE, _BOUNDED = Numbers(), Numbers((1,), LARGEST)
_LENGTH, _VECTOR = Numbers((1,), LARGEST, above_zero=True), Numbers((3,), LARGEST)

CONTACT = (
    "inertia_scaling", "lateral_friction", "rolling_friction", "spinning_friction", "restitution",
    "stiffness", "damping",
)  # fmt: skip
"""Elements of <contact>, each with a value."""
# Element -> its attributes that Bullet reads as numbers.
NUMBERS: dict[str, dict[str, Numbers]] = {
    "mass": {"value": _BOUNDED},
    "inertia": {f"i{axes}": _BOUNDED for axes in ("xx", "xy", "xz", "yy", "yz", "zz")},
    "origin": {"xyz": _VECTOR, "rpy": _VECTOR},
    "box": {"size": Numbers((3,), LARGEST, above_zero=True)},
    "sphere": {"radius": _LENGTH},
    "cylinder": {"radius": _LENGTH, "length": _LENGTH},
    "capsule": {"radius": _LENGTH, "length": _LENGTH},
    "plane": {"normal": _VECTOR},
    "mesh": {"scale": Numbers((1, 3), LARGEST)},
    "cdf": {"scale": Numbers((1, 3), LARGEST)},
    "collision": {"group": _ONE, "mask": _ONE},
    "axis": {"xyz": _VECTOR},
    "limit": dict.fromkeys(("lower", "upper", "twist", "effort", "velocity"), _ONE),
    "dynamics": dict.fromkeys(("damping", "friction"), _ONE),
    "color": {"rgba": Numbers((3, 4))},
    "specular": {"rgb": Numbers((3, 4))},
    **{name: {"value": _ONE} for name in CONTACT},
}

_START_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*""")
_ATTRIBUTE = re.compile(rb"""\s([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")


def check_urdf(path: Path) -> list[Path]:
    """Make sure that Bullet can be given a URDF.

    Returns
    -------
    All files that Bullet will read for it: the URDF, its meshes, their materials and textures.

    Raises
    ------
    ScenarioError
        If it is no well-formed XML, not one tree of links, a number in it is none, or a file that
        it names is not there, no file, or too large.
    """
    try:
        robot = _robot(path)
        for problem in _problems(robot):
            raise BodyFileError(problem)
        return [path, *files_behind(path, [_mesh_name(mesh) for mesh in _meshes(robot)])]
    except BodyFileError as error:
        raise cannot_load(path, str(error)) from None


def cannot_load(path: Path, problem: str) -> ScenarioError:
    """Return the error that says of a URDF why Bullet is not given it."""
    return ScenarioError(
        f"--body must be a URDF that Bullet can load, got {str(path)[:200]!r}: {problem}"
    )


def _robot(path: Path) -> Xml.Element:
    """Read a URDF as Bullet does, whose XML knows neither namespaces nor a document type.

    Numbers are left as they stand in the file: to XML a tab in an attribute is a space, to Bullet
    it is not, and three numbers with tabs between them are none.
    """
    if len(os.fsencode(path)) > LONGEST_VALUE:
        raise BodyFileError(f"its path has more than {LONGEST_VALUE:,} bytes")
    data = read(path, MOST_BYTES)
    if cut := cut_lines(data, LONGEST_LINE):
        raise BodyFileError(cut)
    parser, builder = expat.ParserCreate(), Xml.TreeBuilder()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag in NUMBERS and (raw := _START_TAG.match(data, parser.CurrentByteIndex)):
            as_they_stand = {
                name.decode(): value[1:-1].decode()
                for name, value in _ATTRIBUTE.findall(raw[0])
                if name.decode() in NUMBERS[tag]
            }
            attributes |= as_they_stand
        builder.start(tag, attributes)

    def refuse(*_: object) -> None:
        raise BodyFileError("it declares a document type, which a URDF needs not")

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: unknown encoding
        raise BodyFileError(f"it is no well-formed XML ({error})") from None
    return builder.close()


def _problems(robot: Xml.Element) -> Iterator[str]:
    if robot.tag != "robot":
        yield f"its root is <{robot.tag[:40]}>, not <robot>"
    for kind in ("deformable", "reduced_deformable"):
        if robot.find(kind) is not None:
            yield f"it is a <{kind}> body, and only rigid bodies are dropped"
    yield from _tree_problems(robot)
    yield from _joint_problems(robot)
    for element in robot.iter():
        for name, value in element.attrib.items():
            if len(value) > LONGEST_VALUE:
                yield f"its {name[:40]} of <{element.tag[:40]}> has {len(value):,} letters"
        for name, rule in NUMBERS.get(element.tag, {}).items():
            if (text := element.get(name)) is not None:
                yield from _number_problems(f"{name} of <{element.tag}>", text, rule)


def _tree_problems(robot: Xml.Element) -> Iterator[str]:
    links = [link.get("name", "") for link in robot.findall("link")]
    if len(set(links)) != len(links):
        yield "two of its links have one name"
    children: dict[str, list[str]] = defaultdict(list)
    led_to = set()
    joints = robot.findall("joint")
    for joint in joints:
        children[_end(joint, "parent")].append(_end(joint, "child"))
        led_to.add(_end(joint, "child"))  # a link that two joints lead to is one here
    roots = [link for link in links if link not in led_to]
    if len(roots) != 1 or len(led_to) != len(joints):
        yield f"its links must be one tree, and {len(roots)} of them hang on no joint"
    reached, ahead = set[str](), roots
    while ahead:
        link = ahead.pop()
        reached.add(link)
        ahead += children.pop(link, [])
    if reached != set(links):
        yield "its joints do not lead from one link to all others"


def _joint_problems(robot: Xml.Element) -> Iterator[str]:
    joints = robot.findall("joint")
    if len(joints) > MOST_JOINTS:
        yield f"it has {len(joints):,} joints, and PyBullet reads a body of {MOST_JOINTS} at most"
    positions = sum(POSITIONS.get(joint.get("type", ""), 0) for joint in joints)
    if positions > MOST_POSITIONS:
        yield (
            f"its joints have {positions:,} coordinates, and beyond {MOST_POSITIONS} PyBullet "
            "reads wrong velocities; make some joints fixed"
        )


def _end(joint: Xml.Element, name: str) -> str:
    end = joint.find(name)
    return "" if end is None else end.get("link", "")


def _number_problems(name: str, text: str, rule: Numbers) -> Iterator[str]:
    # Bullet splits at spaces only; within a part C skips what else is white.
    parts = [part.strip() for part in text.split(" ") if part]
    counts = " or ".join(map(str, rule.counts))
    wanted = (
        "a finite number,"
        if rule.counts == (1,)
        else f"{counts} finite numbers with spaces between,"
    )
    if not all(map(NUMBER.fullmatch, parts)) or len(parts) not in rule.counts:
        yield f"{name} must be {wanted} got {text[:40]!r}"
        return
    numbers = [float(part) for part in parts]
    if not all(map(math.isfinite, numbers)):
        yield f"{name} must be {wanted} got {text[:40]!r}"
    elif max(map(abs, numbers)) > rule.largest or (rule.above_zero and min(numbers) <= 0):
        above = "above 0 and " if rule.above_zero else ""
        yield f"{name} must be {above}at most {rule.largest:g}, got {text[:40]!r}"


def _meshes(robot: Xml.Element) -> Iterator[Xml.Element]:
    for kind in ("mesh", "cdf"):
        yield from robot.iterfind(f"link/visual/geometry/{kind}")
        yield from robot.iterfind(f"link/collision/geometry/{kind}")


def _mesh_name(mesh: Xml.Element) -> str:
    return mesh.get("filename", "")

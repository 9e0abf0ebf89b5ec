"""Check a URDF before Bullet reads it.

Bullet's importer trusts its input: a second root link or a name of some thousand letters ends the
process with a segmentation fault, `nan` becomes a length, and a word becomes 0. What cannot be
checked from the text alone is tried (`probe`).
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

from drop_physics.engines.bullet.body_files import (
    NUMBER,
    BodyFileError,
    cut_lines,
    files_behind,
    read,
)
from drop_physics.errors import ScenarioError
from drop_physics.messages import Message

MOST_BYTES = 10_000_000
LONGEST_VALUE = 1000
"""Characters in one attribute; Bullet copies names into arrays on its stack."""
LONGEST_LINE = 8190
"""Bytes: Bullet reads lines of up to 8,191, line end included, and splits longer ones anywhere."""
LARGEST = 1e9
"""Of a mass [kg], a length [m] or an inertia: Bullet's doubles can still square and add it."""
MOST_JOINTS = 127
"""With the base MAX_DEGREE_OF_FREEDOM = 128 links (bullet3's `SharedMemoryCommands.h`); with more
PyBullet reads no pose."""
MOST_POSITIONS = 121
"""Coordinates of all joints: with the base's 7 they fill an array of 128, which the velocities that
PyBullet reads follow."""
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
    """Make sure that a URDF is safe for Bullet to read.

    Returns
    -------
    All files that Bullet will read for it: the URDF, its meshes, their materials and textures.

    Raises
    ------
    ScenarioError
        If it is not well-formed XML or not one tree of links, a number in it is malformed, or a
        file that it names is missing, not a regular file, or too large.
    """
    try:
        robot = _robot(path)
        for problem in _problems(robot):
            raise BodyFileError(problem)
        return [path, *files_behind(path, [_mesh_name(mesh) for mesh in _meshes(robot)])]
    except BodyFileError as error:
        raise cannot_load(path, error.problem) from None


def cannot_load(path: Path, problem: str) -> ScenarioError:
    """Return the error that says why a URDF is rejected."""
    return ScenarioError(
        "--body must be a URDF that Bullet can load, got {path!r}: {problem}",
        path=str(path)[:200],
        problem=problem,
    )


def _robot(path: Path) -> Xml.Element:
    """Parse a URDF as Bullet does, without namespaces and document type.

    Numbers are left as in the file: to XML a tab in an attribute is a space; to Bullet it is not,
    and it cannot read three numbers with tabs between them.
    """
    if len(os.fsencode(path)) > LONGEST_VALUE:
        raise BodyFileError(Message("its path has more than {most:,} bytes", most=LONGEST_VALUE))
    data = read(path, MOST_BYTES)
    if problem := cut_lines(data, LONGEST_LINE):
        raise BodyFileError(problem)
    parser, builder = expat.ParserCreate(), Xml.TreeBuilder()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag in NUMBERS and (raw := _START_TAG.match(data, parser.CurrentByteIndex)):
            unchanged = {
                name.decode(): value[1:-1].decode()
                for name, value in _ATTRIBUTE.findall(raw[0])
                if name.decode() in NUMBERS[tag]
            }
            attributes |= unchanged
        builder.start(tag, attributes)

    def refuse(*_: object) -> None:
        raise BodyFileError(Message("it declares a document type; a URDF has none"))

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: unknown encoding
        raise BodyFileError(
            Message("it is not well-formed XML ({error})", error=str(error))
        ) from None
    return builder.close()


def _problems(robot: Xml.Element) -> Iterator[Message]:
    if robot.tag != "robot":
        yield Message("its root is <{tag}>, not <robot>", tag=robot.tag[:40])
    for kind in ("deformable", "reduced_deformable"):
        if robot.find(kind) is not None:
            yield Message("it is a <{kind}> body; only rigid bodies can be dropped", kind=kind)
    yield from _tree_problems(robot)
    yield from _joint_problems(robot)
    for element in robot.iter():
        for name, value in element.attrib.items():
            if len(value) > LONGEST_VALUE:
                yield Message(
                    "its {name} of <{element}> has {length:,} characters, more than {most:,}",
                    name=name[:40],
                    element=element.tag[:40],
                    length=len(value),
                    most=LONGEST_VALUE,
                )
        for name, rule in NUMBERS.get(element.tag, {}).items():
            if (text := element.get(name)) is not None:
                yield from _number_problems(name, element.tag, text, rule)


def _tree_problems(robot: Xml.Element) -> Iterator[Message]:
    links = [link.get("name", "") for link in robot.findall("link")]
    if len(set(links)) != len(links):
        yield Message("two of its links have the same name")
    children: dict[str, list[str]] = defaultdict(list)
    led_to = set()
    joints = robot.findall("joint")
    for joint in joints:
        children[_end(joint, "parent")].append(_end(joint, "child"))
        led_to.add(_end(joint, "child"))  # a link that two joints lead to is counted once
    roots = [link for link in links if link not in led_to]
    if len(roots) != 1:
        yield Message(
            "its links must be one tree, but {roots} of them are no joint's child",
            roots=len(roots),
        )
    if len(led_to) != len(joints):
        yield Message("its links must be one tree, but two joints have the same child")
    reached, ahead = set[str](), roots
    while ahead:
        link = ahead.pop()
        reached.add(link)
        ahead += children.pop(link, [])
    if reached != set(links):
        yield Message("its joints do not lead from one link to all others")


def _joint_problems(robot: Xml.Element) -> Iterator[Message]:
    joints = robot.findall("joint")
    if len(joints) > MOST_JOINTS:
        yield Message(
            "it has {joints:,} joints; PyBullet reads at most {most}",
            joints=len(joints),
            most=MOST_JOINTS,
        )
    positions = sum(POSITIONS.get(joint.get("type", ""), 0) for joint in joints)
    if positions > MOST_POSITIONS:
        yield Message(
            "its joints have {positions:,} coordinates; beyond {most} PyBullet reads wrong "
            "velocities; make some joints fixed",
            positions=positions,
            most=MOST_POSITIONS,
        )


def _end(joint: Xml.Element, name: str) -> str:
    end = joint.find(name)
    return "" if end is None else end.get("link", "")


def _number_problems(name: str, element: str, text: str, rule: Numbers) -> Iterator[Message]:
    # Bullet splits at spaces only; within a part C skips other white space.
    parts = [part.strip() for part in text.split(" ") if part]
    numbers = [float(part) for part in parts if NUMBER.fullmatch(part)]
    about = {"name": name, "element": element, "text": text[:40]}
    readable = len(numbers) == len(parts) and len(parts) in rule.counts
    if not (readable and all(map(math.isfinite, numbers))):
        first, *others = rule.counts
        if others:
            yield Message(
                "{name} of <{element}> must be {first} or {last} finite numbers separated by "
                "spaces, got {text!r}",
                first=first, last=others[-1], **about,
            )  # fmt: skip
        elif first == 1:
            yield Message("{name} of <{element}> must be a finite number, got {text!r}", **about)
        else:
            yield Message(
                "{name} of <{element}> must be {count} finite numbers separated by spaces, got "
                "{text!r}",
                count=first, **about,
            )  # fmt: skip
    elif rule.above_zero and not (min(numbers) > 0 and max(numbers) <= rule.largest):
        yield Message(
            "{name} of <{element}> must be above 0 and at most {largest:g}, got {text!r}",
            largest=rule.largest, **about,
        )  # fmt: skip
    elif max(map(abs, numbers)) > rule.largest:
        yield Message(
            "{name} of <{element}> must be at most {largest:g}, got {text!r}",
            largest=rule.largest, **about,
        )  # fmt: skip


def _meshes(robot: Xml.Element) -> Iterator[Xml.Element]:
    for kind in ("mesh", "cdf"):
        yield from robot.iterfind(f"link/visual/geometry/{kind}")
        yield from robot.iterfind(f"link/collision/geometry/{kind}")


def _mesh_name(mesh: Xml.Element) -> str:
    return mesh.get("filename", "")

"""Checks URDF and mesh files for input that Bullet would silently misread.

Bullet accepts `nan` as a length, reads a word as 0, and uses the index of a face unchecked, as any
place in memory. Files on which Bullet itself may crash are tested in a separate process (`probe`).
"""

from __future__ import annotations

import math
import os
import re
import stat
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree as Xml

from drop_physics.messages import Message

MOST_URDF_BYTES, MOST_BYTES = 10_000_000, 100_000_000
"""Largest sizes of a URDF and of any file [bytes]. For a mesh, Bullet uses about twenty times its
size in memory."""
LONGEST_VALUE = 1000
"""Largest number of characters in an attribute or a path; Bullet copies them into arrays on its
stack."""
URDF_LINE, MESH_LINE = 8190, 1022
"""Largest number of bytes in a line of a URDF and of a mesh file; Bullet splits longer lines at an
arbitrary place."""
LARGEST = 1e9
"""Largest mass [kg], length [m] or inertia whose square and sum fit in Bullet's doubles."""
LARGEST_INDEX = 100_000_000
"""Largest index of a normal or texture in a .obj: three times this still fits in an int."""
MOST_JOINTS = 127
"""Largest number of joints of a body whose pose PyBullet reads: with the base MAX_DEGREE_OF_FREEDOM
= 128 links (bullet3's `SharedMemoryCommands.h`)."""
MOST_POSITIONS = 121
"""Largest number of coordinates of all joints: with the base's 7 they fill an array of 128, after
which the velocities that PyBullet reads begin."""
POSITIONS = {"revolute": 1, "continuous": 1, "prismatic": 1, "planar": 3, "spherical": 4}
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
"""Pattern of numbers that C and Python parse alike; only Python accepts 1_000."""

BOUNDED = {
    "mass": "value", "inertia": "ixx ixy ixz iyy iyz izz", "origin": "xyz rpy", "axis": "xyz",
    "box": "size", "sphere": "radius", "cylinder": "radius length", "capsule": "radius length",
    "plane": "normal", "mesh": "scale", "cdf": "scale",
}  # fmt: skip
FINITE = {
    "collision": "group mask", "limit": "lower upper twist effort velocity",
    "dynamics": "damping friction", "color": "rgba", "specular": "rgb",
    "inertia_scaling": "value", "lateral_friction": "value", "rolling_friction": "value",
    "spinning_friction": "value", "restitution": "value", "stiffness": "value", "damping": "value",
}  # fmt: skip
"""Elements with attributes that Bullet parses as numbers, which must be finite."""
COUNTS = {
    "xyz": (3,), "rpy": (3,), "size": (3,), "normal": (3,), "scale": (1, 3), "rgba": (3, 4),
    "rgb": (3, 4),
}  # fmt: skip
"""Number of values that an attribute may hold; one for attributes not listed."""
ABOVE_ZERO = ("size", "radius", "length")


class BodyFileError(Exception):
    """Raised for an invalid body file."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.problem = problem


def read(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file of bounded size.

    Raises
    ------
    BodyFileError
        If it is not a regular file, too large, or cannot be read.
    """
    shown = str(path)[-100:]
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise BodyFileError(Message("{path!r} is not a regular file", path=shown))
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise BodyFileError(
            Message("{path!r} cannot be read ({reason})", path=shown, reason=error.strerror)
        ) from None
    if len(data) > most:
        raise BodyFileError(Message("{path!r} has more than {most:,} bytes", path=shown, most=most))
    return data


def check_urdf(path: Path) -> None:
    """Check that Bullet reads the numbers in a URDF as they are written."""
    if len(os.fsencode(path)) > LONGEST_VALUE:
        raise BodyFileError(Message("its path has more than {most:,} bytes", most=LONGEST_VALUE))
    data = read(path, MOST_URDF_BYTES)
    for problem in (_cut_lines(data, URDF_LINE), *_urdf_problems(data)):
        if problem:
            raise BodyFileError(problem)


def check_mesh(path: Path) -> None:
    """Check that Bullet reads a mesh as it is written; only .obj and .stl are checked."""
    check: Callable[[bytes], str] | None = {".obj": _obj_problem, ".stl": _stl_problem}.get(
        path.suffix.lower()
    )
    if check is not None and (problem := check(read(path))):
        shown = str(path)[-100:]
        raise BodyFileError(Message("{path!r}: {problem}", path=shown, problem=problem))


def _cut_lines(data: bytes, longest: int) -> str:
    """Return what Bullet would misread in the lines of a text file, or ''."""
    if re.search(rb"\r(?!\r*(?:\n|\Z))", data) or b"\0" in data:
        return Message(
            "Bullet skips what follows a carriage return or a NUL; end lines with a line feed"
        )
    if max(map(len, data.split(b"\n"))) > longest:
        return Message(
            "it has a line of more than {longest:,} bytes, which Bullet would split; split it",
            longest=longest,
        )
    return ""


# -- a URDF ---------------------------------------------------------------------------------------


def _urdf_problems(data: bytes) -> Iterator[str]:
    try:
        text = data.decode()
        if "<!DOCTYPE" in text:
            yield Message("it declares a document type; a URDF has none")
        robot = Xml.fromstring(text)
    except (Xml.ParseError, ValueError) as error:
        yield Message("it is not well-formed XML in UTF-8 ({error})", error=str(error))
        return
    # Bullet reads three numbers with a tab between them as one, and that one for all axes.
    if re.search(r"""\bscale\s*=\s*("[^"]*[\t\r\n]|'[^']*[\t\r\n])""", text):
        yield Message("a scale must hold numbers separated by spaces, not tabs or line ends")
    joints = robot.findall("joint")
    positions = sum(POSITIONS.get(joint.get("type", ""), 0) for joint in joints)
    if len(joints) > MOST_JOINTS or positions > MOST_POSITIONS:
        yield Message(
            "it has {joints:,} joints with {positions:,} coordinates; PyBullet reads at most "
            "{most_joints} and {most}; make some joints fixed, or merge links",
            joints=len(joints),
            positions=positions,
            most_joints=MOST_JOINTS,
            most=MOST_POSITIONS,
        )
    for element in robot.iter():
        tag = element.tag.rpartition("}")[2]  # to Bullet a namespace is an attribute
        bounded = tag in BOUNDED
        numbers = (BOUNDED if bounded else FINITE).get(tag, "").split()
        for name, value in element.attrib.items():
            if len(value) > LONGEST_VALUE:
                yield Message(
                    "its {name} of <{element}> has {length:,} characters, more than {most:,}",
                    name=name[:40],
                    element=tag[:40],
                    length=len(value),
                    most=LONGEST_VALUE,
                )
            elif name in numbers:
                yield from _number_problems(name, tag, value, LARGEST if bounded else math.inf)


def _number_problems(name: str, element: str, text: str, largest: float) -> Iterator[str]:
    # Bullet splits at spaces only; within a part C skips other white space.
    parts = [part.strip() for part in text.split(" ") if part]
    numbers = [float(part) for part in parts if NUMBER.fullmatch(part)]
    counts, about = COUNTS.get(name, (1,)), {"name": name, "element": element, "text": text[:40]}
    readable = len(numbers) == len(parts) and len(parts) in counts
    if not (readable and all(map(math.isfinite, numbers))):
        yield Message(
            "{name} of <{element}> must be {count} finite numbers separated by spaces, got "
            "{text!r}",
            count=counts[-1],
            **about,
        )
    elif name in ABOVE_ZERO and not min(numbers) > 0:
        yield Message("{name} of <{element}> must be above 0, got {text!r}", **about)
    elif max(map(abs, numbers)) > largest:
        yield Message(
            "{name} of <{element}> must be at most {largest:g}, got {text!r}",
            largest=largest,
            **about,
        )


# -- meshes ---------------------------------------------------------------------------------------


def _stl_problem(data: bytes) -> str:
    # Bullet computes the size of a file from its number of triangles in 32 bits.
    if len(data) < 84 or len(data) != 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return Message(
            "Bullet reads only binary .stl, and this is not one, or truncated; save it as binary"
        )
    vertices = struct.iter_unpack("<12x9f2x", data[84:])
    if not all(math.isfinite(sum(triangle)) for triangle in vertices):
        return Message("one of its coordinates is not a finite number")
    return ""


_CORNER = re.compile(rb"(-?\d{1,10})(?:/(-?\d{1,10})?(?:/(-?\d{1,10}))?)?")
"""Pattern of a face vertex: i, i/j, i//k or i/j/k."""


def _obj_problem(data: bytes) -> str:
    if cut := _cut_lines(data, MESH_LINE):
        return cut
    vertices, highest, faces = 0, 0, 0
    for line in data.split(b"\n"):
        kind, *parts = line.split() or [b""]
        if kind == b"v":
            numbers = [part.decode(errors="replace") for part in parts[:3]]
            read = len(numbers) == 3 and all(map(NUMBER.fullmatch, numbers))
            if not (read and math.isfinite(sum(map(float, numbers)))):
                return Message("{line!r} must hold three finite numbers", line=_quoted(line))
            vertices += 1
        elif kind == b"f":
            faces += 1
            for part in parts:
                match = _CORNER.fullmatch(part)
                indices = [int(group) for group in match.groups() if group] if match else [0]
                if 0 in indices or max(map(abs, indices)) > LARGEST_INDEX:
                    return Message("{corner!r} is not a corner of a face", corner=_quoted(part))
                if indices[0] < -vertices:
                    return Message("{corner!r} is a vertex before the first", corner=_quoted(part))
                highest = max(highest, indices[0])
    if not faces:
        return Message("it has no faces, so there is nothing to hit or draw")
    if highest > vertices:
        return Message(
            "a face has vertex {highest:,}, but there are {vertices:,}",
            highest=highest,
            vertices=vertices,
        )
    return ""


def _quoted(text: bytes) -> str:
    return text[:40].decode(errors="replace")

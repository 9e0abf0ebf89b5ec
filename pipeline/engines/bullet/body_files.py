"""The files that a URDF names: found where Bullet looks for them, and looked at before it does.

Bullet opens whatever bears the name, and waits for a pipe for ever. Of a mesh it believes every
index and every count.
"""

from __future__ import annotations

import math
import os
import re
import stat
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

MOST_BYTES = 100_000_000
"""In one file: Bullet takes some twenty times that in memory."""
LONGEST_PATH = 1000
"""Bytes; Bullet writes paths into arrays of 1,024."""
FORMATS = (".obj", ".stl", ".dae", ".cdf", ".vtk")
"""Suffixes, of any case, of what Bullet takes for a mesh."""
LONGEST_LINE = 1022
"""Bytes in a .obj or .mtl, of which Bullet reads lines of 1,023, their end included."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
"""What C and Python read alike; Python alone takes 1_000."""
LARGEST_INDEX = 100_000_000
"""Of a normal or texture in a .obj: three times that is still an int."""
PREFIXES = ("./", "./data/", "../data/", "../../data/", "../../../data/", "../../../../data/")
"""Where Bullet looks for textures too."""


class BodyFileError(Exception):
    """What is wrong with a file, in a few words."""


def read(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return what is in a file, which is a regular one of bounded size.

    Raises
    ------
    BodyFileError
        If it is neither, or cannot be read.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise BodyFileError(f"{_shown(path)} is no regular file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise BodyFileError(f"{_shown(path)} cannot be read ({error.strerror})") from None
    if len(data) > most:
        raise BodyFileError(f"{_shown(path)} has more than {most:,} bytes")
    return data


def _shown(path: Path) -> str:
    return repr(str(path)[-100:])


def files_behind(urdf: Path, names: Iterable[str]) -> list[Path]:
    """Return the meshes that a URDF names, and the materials and textures that they name.

    Raises
    ------
    BodyFileError
        If a mesh is not there, or one of these is no regular file.
    """
    files: dict[Path, None] = {}
    for name in names:
        mesh = _found(urdf, name)
        if mesh in files:
            continue
        files[mesh] = None
        if mesh.suffix.lower() == ".obj":
            for material in _named(read(mesh), b"mtllib", _near(mesh)):
                files[material] = None
                files |= dict.fromkeys(_named(read(material), b"map_Kd", _near(mesh)))
    return list(files)


def _found(urdf: Path, name: str) -> Path:
    """Return which file Bullet takes for a mesh (`UrdfFindMeshFile.h`)."""
    if len(name) <= 4 or not name.lower().endswith(FORMATS):
        raise BodyFileError(
            f"Bullet reads meshes of {', '.join(FORMATS[:3])}, and no {name[:100]!r}"
        )
    bare = name.removeprefix("file://")
    shorter = bare.removeprefix("package://")
    bare = shorter if shorter != bare else bare.removeprefix("model://")
    above = [str(urdf)[: slash.end()] for slash in re.finditer(r"[/\\]", str(urdf))]
    for prefix in ("", *reversed(above), "./", "../", "../../"):
        attempt = Path(prefix + bare)
        if _opens(attempt):
            return attempt
    raise BodyFileError(f"there is no mesh {name[:100]!r} beside or above it")


def _opens(path: Path) -> bool:
    """Return whether Bullet opens something of this name.

    Raises
    ------
    BodyFileError
        If that is no regular file.
    """
    try:
        there = os.access(path, os.R_OK)
    except ValueError:  # a zero in it
        return False
    if there and not path.is_file():
        raise BodyFileError(f"{_shown(path)} is no regular file")
    if there and len(os.fsencode(path)) > LONGEST_PATH:
        raise BodyFileError(f"{_shown(path)} has a path of more than {LONGEST_PATH:,} bytes")
    return there


def _near(mesh: Path) -> tuple[str, ...]:
    return (f"{mesh.parent}/", "", *PREFIXES)


def _named(data: bytes, keyword: bytes, prefixes: Iterable[str]) -> Iterator[Path]:
    """Yield what is there of the files that follow a keyword, wherever Bullet may look for them."""
    for name in re.findall(rb"^[ \t]*%s[ \t]+([^\r\n]*)" % keyword, data, re.MULTILINE):
        for prefix in prefixes:
            path = Path(prefix + os.fsdecode(name.strip()))
            if name.strip() and _opens(path):
                yield path


# -- what is in them ------------------------------------------------------------------------------


def check_content(path: Path) -> None:
    """Make sure of a mesh that Bullet reads in it what is in it.

    Of .dae and .cdf files nothing is known: they are tried.

    Raises
    ------
    BodyFileError
        If it would not.
    """
    check: Callable[[bytes], str] | None = {".obj": _obj_problem, ".stl": _stl_problem}.get(
        path.suffix.lower()
    )
    if check is not None and (problem := check(read(path))):
        raise BodyFileError(f"{_shown(path)}: {problem}")


def cut_lines(data: bytes, longest: int) -> str:
    """Return what is wrong with the lines of a text that Bullet reads, or nothing."""
    if re.search(rb"\r(?!\r*(?:\n|\Z))", data) or b"\0" in data:
        return "Bullet skips what follows a carriage return or a zero; end lines with a line feed"
    if max(map(len, data.split(b"\n"))) > longest:
        return f"it has a line of more than {longest:,} bytes, which Bullet would break; break it"
    return ""


def _stl_problem(data: bytes) -> str:
    # Bullet computes the size of a file that has so many triangles in 32 bits.
    if len(data) < 84 or len(data) != 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return "Bullet reads binary .stl only, and this is none, or is cut; save it as binary"
    vertices = struct.iter_unpack("<12x9f2x", data[84:])
    if not all(math.isfinite(sum(triangle)) for triangle in vertices):
        return "one of its coordinates is no finite number"
    return ""


def _obj_problem(data: bytes) -> str:
    if cut := cut_lines(data, LONGEST_LINE):
        return cut
    vertices, highest, faces = 0, 0, 0
    for line in data.split(b"\n"):
        kind, *parts = line.split() or [b""]
        if kind == b"v":
            numbers = [part.decode(errors="replace") for part in parts[:3]]
            read = len(numbers) == 3 and all(map(NUMBER.fullmatch, numbers))
            if not (read and math.isfinite(sum(map(float, numbers)))):
                return f"{_quoted(line)} are no three finite numbers"
            vertices += 1
        elif kind == b"f":
            faces += 1
            for part in parts:
                indices = _indices(part)
                if not indices or 0 in indices or max(map(abs, indices)) > LARGEST_INDEX:
                    return f"{_quoted(part)} is no corner of a face"
                if indices[0] < -vertices:
                    return f"{_quoted(part)} is a vertex before the first"
                highest = max(highest, indices[0])
    if not faces:
        return "it has no faces, so that there is nothing to meet or to draw"
    if highest > vertices:
        return f"a face has vertex {highest:,}, and there are {vertices:,}"
    return ""


def _quoted(text: bytes) -> str:
    return repr(text[:40].decode(errors="replace"))


_CORNER = re.compile(rb"(-?\d{1,10})(?:/(-?\d{1,10})?(?:/(-?\d{1,10}))?)?")


def _indices(corner: bytes) -> list[int]:
    """Return the numbers in i, i/j, i//k or i/j/k; none where it is another thing."""
    match = _CORNER.fullmatch(corner)
    return [int(group) for group in match.groups() if group] if match else []

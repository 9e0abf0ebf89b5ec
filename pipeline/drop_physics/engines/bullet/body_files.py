"""The files that a URDF names, found where Bullet looks for them and checked before it reads them.

Bullet opens anything of that name, and waits for a pipe forever. It trusts every index and every
count in a mesh.
"""

from __future__ import annotations

import math
import os
import re
import stat
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from drop_physics.messages import Message

MOST_BYTES = 100_000_000
"""Per file; Bullet takes some twenty times that in memory."""
LONGEST_PATH = 1000
"""Bytes; Bullet copies paths into arrays of 1,024."""
FORMATS = (".obj", ".stl", ".dae", ".cdf", ".vtk")
"""Suffixes, in any case, of files that Bullet takes for meshes."""
LONGEST_LINE = 1022
"""Bytes in a .obj or .mtl: Bullet reads lines of up to 1,023, line end included."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
"""Numbers that C and Python read alike; only Python accepts 1_000."""
LARGEST_INDEX = 100_000_000
"""Of a normal or texture in a .obj: three times that still fits in an int."""
PREFIXES = ("./", "./data/", "../data/", "../../data/", "../../../data/", "../../../../data/")
"""Where Bullet also looks for textures."""


class BodyFileError(Exception):
    """Something is wrong with a file."""

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
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise _not_regular(path)
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise BodyFileError(
            Message("{path!r} cannot be read ({reason})", path=_shown(path), reason=error.strerror)
        ) from None
    if len(data) > most:
        raise BodyFileError(
            Message("{path!r} has more than {most:,} bytes", path=_shown(path), most=most)
        )
    return data


def _not_regular(path: Path) -> BodyFileError:
    return BodyFileError(Message("{path!r} is not a regular file", path=_shown(path)))


def _shown(path: Path) -> str:
    return str(path)[-100:]


def files_behind(urdf: Path, names: Iterable[str]) -> list[Path]:
    """Return the meshes that a URDF names, and the materials and textures that they name.

    Raises
    ------
    BodyFileError
        If a mesh is missing, or one of the files is not a regular file.
    """
    files: dict[Path, None] = {}
    for name in names:
        mesh = _mesh_path(urdf, name)
        if mesh in files:
            continue
        files[mesh] = None
        if mesh.suffix.lower() == ".obj":
            for material in _references(read(mesh), b"mtllib", _near(mesh)):
                files[material] = None
                files |= dict.fromkeys(_references(read(material), b"map_Kd", _near(mesh)))
    return list(files)


def _mesh_path(urdf: Path, name: str) -> Path:
    """Return the file that Bullet opens for a mesh (`UrdfFindMeshFile.h`)."""
    if len(name) <= 4 or not name.lower().endswith(FORMATS):
        raise BodyFileError(
            Message("Bullet reads meshes of .obj, .stl or .dae, got {name!r}", name=name[:100])
        )
    bare = name.removeprefix("file://")
    shorter = bare.removeprefix("package://")
    bare = shorter if shorter != bare else bare.removeprefix("model://")
    above = [str(urdf)[: slash.end()] for slash in re.finditer(r"[/\\]", str(urdf))]
    for prefix in ("", *reversed(above), "./", "../", "../../"):
        attempt = Path(prefix + bare)
        if _opens(attempt):
            return attempt
    raise BodyFileError(
        Message("there is no mesh {name!r} in its folder or above", name=name[:100])
    )


def _opens(path: Path) -> bool:
    """Return whether Bullet can open a file of this name.

    Raises
    ------
    BodyFileError
        If that is not a regular file, or its path is too long.
    """
    try:
        readable = os.access(path, os.R_OK)
    except ValueError:  # a NUL in it
        return False
    if readable and not path.is_file():
        raise _not_regular(path)
    if readable and len(os.fsencode(path)) > LONGEST_PATH:
        raise BodyFileError(
            Message(
                "the path of {path!r} has more than {most:,} bytes",
                path=_shown(path),
                most=LONGEST_PATH,
            )
        )
    return readable


def _near(mesh: Path) -> tuple[str, ...]:
    return (f"{mesh.parent}/", "", *PREFIXES)


def _references(data: bytes, keyword: bytes, prefixes: Iterable[str]) -> Iterator[Path]:
    """Yield the existing files named after a keyword, wherever Bullet may look for them."""
    for name in re.findall(rb"^[ \t]*%s[ \t]+([^\r\n]*)" % keyword, data, re.MULTILINE):
        for prefix in prefixes:
            path = Path(prefix + os.fsdecode(name.strip()))
            if name.strip() and _opens(path):
                yield path


# -- their content --------------------------------------------------------------------------------


def check_content(path: Path) -> None:
    """Make sure that Bullet reads a mesh as it is written.

    .dae and .cdf files are not checked here: they are tried.

    Raises
    ------
    BodyFileError
        If it would read something else.
    """
    check: Callable[[bytes], str] | None = {".obj": _obj_problem, ".stl": _stl_problem}.get(
        path.suffix.lower()
    )
    if check is not None and (problem := check(read(path))):
        raise BodyFileError(Message("{path!r}: {problem}", path=_shown(path), problem=problem))


def cut_lines(data: bytes, longest: int) -> str:
    """Return what is wrong with the lines of a text that Bullet reads, or ''."""
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
                return Message("{line!r} must hold three finite numbers", line=_quoted(line))
            vertices += 1
        elif kind == b"f":
            faces += 1
            for part in parts:
                indices = _indices(part)
                if not indices or 0 in indices or max(map(abs, indices)) > LARGEST_INDEX:
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


_CORNER = re.compile(rb"(-?\d{1,10})(?:/(-?\d{1,10})?(?:/(-?\d{1,10}))?)?")


def _indices(corner: bytes) -> list[int]:
    """Return the numbers in i, i/j, i//k or i/j/k; none if it is something else."""
    match = _CORNER.fullmatch(corner)
    return [int(group) for group in match.groups() if group] if match else []

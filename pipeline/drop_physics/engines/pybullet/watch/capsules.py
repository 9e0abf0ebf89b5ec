"""Corrects poses of MJCF capsules and cylinders, which PyBullet reports wrongly.

PyBullet loads these shapes correctly, but `getVisualShapeData` reports them upright, at the link's
centre.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

from .links import walk

CAPSULES = (4, 7)
"""Shape types in `getVisualShapeData`: cylinder and capsule."""
LINK, KIND, SIZE, POSITION, ORIENTATION = 1, 2, 3, 5, 6
"""Column indices in `getVisualShapeData`."""
UNKNOWN = -1
"""Shape type that marks an unknown pose."""
UPRIGHT = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]

Ends = tuple[list[float], list[float]]


def lay(shapes: list[Any], names: list[str], path: str | None) -> None:
    """Correct the poses of a body's capsules and cylinders, as given in its MJCF file.

    Parameters
    ----------
    shapes
        The result of `getVisualShapeData`, as lists.
    names
        The names of the base and of the links.
    path
        The path of the MJCF file; None if it is unknown.
    """
    ends: dict[str, list[Ends]] = {}
    with contextlib.suppress(OSError):
        ends = ends_in(path) if path else {}
    for shape in shapes:
        if shape[KIND] not in CAPSULES or (shape[POSITION], shape[ORIENTATION]) != UPRIGHT:
            continue
        its = ends.get(names[shape[LINK] + 1])
        if its is None:
            shape[KIND] = UNKNOWN
            continue
        for low, high in its:
            if math.isclose(math.dist(low, high), shape[SIZE][0], rel_tol=1e-6):
                shape[POSITION] = [(a + b) / 2 for a, b in zip(low, high)]
                shape[ORIENTATION] = _from_z_to([b - a for a, b in zip(low, high)])
                its.remove((low, high))
                break


def ends_in(path: str) -> dict[str, list[Ends]]:
    """Return the end points (`fromto`) of shapes in an MJCF, by body; skip repeated names."""
    ends: dict[str, list[Ends]] = {}
    names: dict[int, str | None] = {}
    """The names of the bodies that an element is in, by their depth."""
    twice: set[str] = set()

    def start(within: tuple[str, ...], attributes: dict[str, str]) -> None:
        depth = max((at for at, tag in enumerate(within) if tag == "body"), default=-1)
        if within[-1] == "body":
            name = names[depth] = attributes.get("name")
            if name is not None and name in ends:
                twice.add(name)
            elif name is not None:
                ends[name] = []
            return
        name = names.get(depth)
        if within[-1] == "geom" and name is not None and "fromto" in attributes:
            numbers = [float(number) for number in attributes["fromto"].split()]
            if len(numbers) == 6 and numbers[:3] != numbers[3:]:
                ends[name].append((numbers[:3], numbers[3:]))

    walk(path, start)
    return {name: its for name, its in ends.items() if name not in twice}


def _from_z_to(direction: list[float]) -> list[float]:
    """Return the quaternion x, y, z, w that turns the z axis to a direction or its opposite."""
    length = math.copysign(math.hypot(*direction), direction[2])
    x, y, z = (component / length for component in direction)
    norm = math.hypot(y, x, 1 + z)
    return [-y / norm, x / norm, 0.0, (1 + z) / norm]

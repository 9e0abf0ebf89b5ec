"""Reads properties that a URDF or MJCF states but PyBullet may not apply.

These are the inertias, masses and mimic joints of a URDF, and the damping of an MJCF.
"""

from __future__ import annotations

import os
from typing import Any

from .links import MOST_BYTES, walk

INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

_read: dict[str, tuple[Any, dict[str, Any] | None]] = {}
"""Contents of files that were read, with their modification times and sizes."""


def asked_of(path: str) -> dict[str, Any] | None:
    """Return the link and joint properties stated in a URDF; None if it cannot be read.

    `links`: name, mass [kg] or None, inertia (none or six numbers), position and angles of the
    inertial frame. `mimics`: joint, the joint that it follows, multiplier, offset. `concave`:
    whether any mesh requests not to be replaced by its convex hull.
    """
    try:
        status = os.stat(path)
        state = status.st_mtime_ns, status.st_size
        if status.st_size > MOST_BYTES:
            return None
        known = _read.get(path)
        if known is None or known[0] != state:
            known = _read[path] = state, _parsed(path)
    except OSError:
        return None
    return known[1]


def _parsed(path: str) -> dict[str, Any] | None:
    links: list[list[Any]] = []
    mimics: list[list[Any]] = []
    joint = [""]
    found: dict[str, Any] = {"links": links, "mimics": mimics, "concave": False}

    def start(within: tuple[str, ...], attributes: dict[str, str]) -> None:
        if within == ("robot", "link"):
            links.append([attributes["name"], None, [], [0.0] * 3, [0.0] * 3])
        elif within == ("robot", "link", "inertial", "origin"):
            for at, key in ((3, "xyz"), (4, "rpy")):
                if key in attributes:
                    links[-1][at] = [float(each) for each in attributes[key].split()]
        elif within == ("robot", "link", "inertial", "mass"):
            links[-1][1] = float(attributes["value"])
        elif within == ("robot", "link", "inertial", "inertia"):
            links[-1][2] = [float(attributes.get(key, 0)) for key in INERTIA]
        elif within == ("robot", "joint"):
            joint[0] = attributes["name"]
        elif within == ("robot", "joint", "mimic"):
            factor, offset = attributes.get("multiplier", 1), attributes.get("offset", 0)
            mimics.append([joint[0], attributes["joint"], float(factor), float(offset)])
        elif within == ("robot", "link", "collision"):
            found["concave"] |= "concave" in attributes

    return found if walk(path, start) else None


def dampings_in(path: str) -> list[list[Any]]:
    """Return the joint damping stated in an MJCF, by joint name.

    Only the outermost `<default>` is read; defaults of named classes are ignored.
    """
    default, found = [""], list[list[Any]]()

    def start(within: tuple[str, ...], attributes: dict[str, str]) -> None:
        if within == ("mujoco", "default", "joint"):
            default[0] = attributes.get("damping", "")
        elif within[:2] == ("mujoco", "worldbody") and within[-1] == "joint":
            given = attributes.get("damping") or ("class" not in attributes and default[0])
            if "name" in attributes and given:
                found.append([attributes["name"], float(given)])

    try:
        walk(path, start)
    except OSError:
        return []
    return found

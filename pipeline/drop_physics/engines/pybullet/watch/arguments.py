"""Names the arguments of PyBullet calls, and converts them as PyBullet does."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ARGUMENTS: dict[str, list[str]] = json.loads(
    Path(__file__).with_name("arguments.json").read_text(encoding="utf-8")
)
"""The names of every function's arguments, in order, in PyBullet 3.2.7."""

CLIENT = "physicsClientId"
CLIENT_AT = {
    name: names.index(CLIENT) if CLIENT in names else 1000 for name, names in ARGUMENTS.items()
}
"""Index of the client id among each function's arguments; 1000 if it has none."""
BODY_NAMES = ("bodyUniqueId", "objectUniqueId", "bodyIndex")
UNNAMED = "setJointMotorControl"
"""A motor function that takes only positional arguments, and always client 0; the meaning of the
arguments depends on their number and on the control mode."""
MODE_AT = 2
MODES = {
    0: ("targetVelocity", "velocityGain"),
    1: ("force", ""),
    2: ("targetPosition", "positionGain"),
}
"""Names of the fourth and sixth argument of a motor call, by control mode."""


def names_of(name: str, args: tuple[Any, ...]) -> Sequence[str]:
    """Return the names of a call's positional arguments; '' for arguments that PyBullet ignores."""
    if name != UNNAMED:
        return ARGUMENTS.get(name, ())
    mode = number(args[MODE_AT]) if len(args) > MODE_AT else None
    target, gain = ("", "") if mode is None else MODES.get(mode, ("", ""))
    found = ["bodyUniqueId", "jointIndex", "controlMode", target, "force", gain]
    if len(args) == 8:
        force = "" if target == "force" else "force"
        found[3:] = "targetPosition", "targetVelocity", force, "positionGain", "velocityGain"
    return found


def named(name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a call by name."""
    return {**dict(zip(names_of(name, args), args)), **kwargs}


def client_of(name: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> int:
    """Return the physics client id of a call: the last argument, or 0."""
    client = kwargs.get(CLIENT)
    if client is None:
        at = CLIENT_AT.get(name, 1000)
        client = args[at] if len(args) > at else 0
    return client if type(client) is int else number(client) or 0


def body_of(arguments: dict[str, Any]) -> int | None:
    """Return the id of the body that a call is about."""
    for name in BODY_NAMES:
        if name in arguments:
            return number(arguments[name])
    return None


def number(value: Any) -> int | None:
    """Return an integer as PyBullet would convert it; None if it cannot."""
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError):
        return None


def vector(value: Any) -> list[float] | None:
    """Return a vector as PyBullet would convert it; None if it cannot."""
    try:
        return [float(item) for item in value]
    except (TypeError, ValueError, OverflowError):
        return None


def values(arguments: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments that are numbers or vectors of numbers."""
    found: dict[str, Any] = {}
    for name, value in arguments.items():
        if name == CLIENT:
            continue
        if isinstance(value, int):
            found[name] = int(value)
        else:
            try:
                found[name] = float(value)
            except (TypeError, ValueError, OverflowError):
                numbers = vector(value)
                if numbers is not None:
                    found[name] = numbers
    return found

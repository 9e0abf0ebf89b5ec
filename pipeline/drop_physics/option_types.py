"""Types of option values: the parser of each type, and its components.

Texts are parsed, never evaluated as code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

from drop_physics.errors import ScenarioError

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def number(text: str) -> float:
    """Parse a number or a fraction such as `1/480`, without evaluating expressions."""
    try:
        digits = _digits(text)
        return float(Fraction(digits)) if "/" in digits else float(digits)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise ScenarioError("a number or a fraction such as 1/480") from None


def _digits(text: str) -> str:
    """Return a number's text, but refuse forms that only Python accepts: `1_0`, or `١` for 1.

    Raises
    ------
    ValueError
        If the text has a form that only Python accepts.
    """
    if "_" in text or not text.isascii():
        raise ValueError
    return text


def integer(text: str) -> int:
    """Parse an integer."""
    try:
        return int(_digits(text))
    except ValueError:
        raise ScenarioError("a whole number") from None


def vector(text: str) -> Vector:
    """Parse a vector `X,Y,Z`."""
    parts = text.split(",")
    if len(parts) != 3:
        raise ScenarioError("three numbers X,Y,Z") from None
    x, y, z = map(number, parts)
    return x, y, z


def orientation(text: str) -> Vector | Quaternion:
    """Parse an orientation: `R,P,Y` or `X,Y,Z,W`."""
    match [number(part) for part in text.split(",")]:
        case [roll, pitch, yaw]:
            return roll, pitch, yaw
        case [x, y, z, w]:
            return x, y, z, w
    raise ScenarioError("angles R,P,Y [deg] or a quaternion X,Y,Z,W") from None


def size(text: str) -> tuple[int, int]:
    """Parse an image size `WIDTHxHEIGHT` in pixels."""
    try:
        width, height = map(integer, text.lower().split("x"))
    except ValueError:
        raise ScenarioError("WIDTHxHEIGHT in pixels, such as 480x360") from None
    return width, height


def times(texts: Sequence[str]) -> list[float]:
    """Parse the times of `--at` [s].

    Raises
    ------
    ScenarioError
        If a text is not a number.
    """
    try:
        return [number(text) for text in texts]
    except ScenarioError as error:
        raise ScenarioError(
            "{option} takes {what}, got {value}",
            option="--at",
            what=error.in_options,
            value=", ".join(map(repr, texts)),
        ) from None


@dataclass(frozen=True, slots=True)
class OptionType:
    """A type of option value: its parser and the text form."""

    read: Callable[[str], Any]
    """Parser of a text; its ScenarioError states the expected form."""
    metavar: str
    """Placeholder in `--help`."""
    of: type[float | int | str]
    """Python type of the value, or of its components."""
    lengths: tuple[int, ...] = ()
    """Allowed numbers of components; empty for a single value."""
    components: tuple[str, ...] = ()
    """Names of the components, if each can be given separately."""
    joined: str = ","
    """The separator between components."""


NUMBER = OptionType(number, "NUMBER", float)
INTEGER = OptionType(integer, "N", int)
VECTOR = OptionType(vector, "X,Y,Z", float, (3,), ("x", "y", "z"))
ORIENTATION = OptionType(orientation, "R,P,Y|X,Y,Z,W", float, (3, 4), ("roll", "pitch", "yaw"))
SIZE = OptionType(size, "WIDTHxHEIGHT", int, (2,), joined="x")
TEXT = OptionType(str, "TEXT", str)


def checked_windows(given: Iterable[str]) -> list[tuple[int, int]]:
    """Return step windows given as texts A:B, as pairs of integers.

    Raises
    ------
    ScenarioError
        If a text has another form.
    """
    windows = []
    for text in given:
        first, _, end = text.partition(":")
        if not (first.isdecimal() and end.isdecimal() and int(first) < int(end)):
            raise ScenarioError(
                "--steps must be A:B, the first step and the one after the last, got {text!r}; "
                "such as --steps 1000:1200",
                text=text,
            )
        windows.append((int(first), int(end)))
    return windows


def checked_episodes(
    given: str | int | Sequence[str] | None,
) -> Literal["failing", "all"] | int | None:
    """Return which episodes to record step by step: `failing`, `all` or an episode's number.

    Raises
    ------
    ScenarioError
        If the value is anything else.
    """
    if not given and given != 0:
        return None
    text = str(given)
    if text == "failing":
        return "failing"
    if text == "all":
        return "all"
    if not (text.isascii() and text.isdecimal() and int(text)):
        raise ScenarioError(
            "--episodes must be failing, all, or the number of an episode, from 1; got {text!r}",
            text=text,
        )
    return int(text)

"""A field that knows its command-line option: how it is written, and which values it may hold.

What is declared once here serves the command line, the recording and a sweep alike. Text is only
ever parsed, never evaluated.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Self

from pipeline.errors import ScenarioError

Vector = tuple[float, float, float]


def number(text: str) -> float:
    """Read a number or a fraction such as `1/480`; nothing is evaluated."""
    try:
        return float(Fraction(text)) if "/" in text else float(text)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise ScenarioError("a number or a fraction such as 1/480") from None


def fraction(value: float) -> str:
    """Write 1/240 where a float is 1/240, else the number."""
    exact = Fraction(value).limit_denominator(1_000_000)
    if float(exact) == value and exact.denominator > 10:
        return str(exact)
    return f"{value:.9g}"


def integer(text: str) -> int:
    """Read a whole number."""
    try:
        return int(text)
    except ValueError:
        raise ScenarioError("a whole number") from None


def vector(text: str) -> Vector:
    """Read `X,Y,Z`."""
    parts = text.split(",")
    if len(parts) != 3:
        raise ScenarioError("three numbers X,Y,Z") from None
    x, y, z = map(number, parts)
    return x, y, z


def size(text: str) -> tuple[int, int]:
    """Read `WIDTHxHEIGHT` in pixels."""
    try:
        width, height = map(int, text.lower().split("x"))
    except ValueError:
        raise ScenarioError("WIDTHxHEIGHT in pixels, such as 480x360") from None
    return width, height


def text(value: str) -> str:
    """Take the text as it is."""
    return value


def times(texts: Sequence[str]) -> list[float]:
    """Read the times of `--at` [s].

    Raises
    ------
    ScenarioError
        If one of them is no number.
    """
    try:
        return [number(one) for one in texts]
    except ScenarioError as error:
        raise ScenarioError(f"--at takes {error}, got {', '.join(map(repr, texts))}") from None


# -- one field: its option, its domain ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Option:
    """How a field is given on the command line, and which numbers it may hold."""

    name: str
    help: str
    parse: Callable[[str], Any]
    default: str
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    """Whether `low` itself is excluded."""

    @property
    def is_flag(self) -> bool:
        """Whether giving the option switches the field off."""
        return self.name.startswith("--no-")

    def domain(self) -> str:
        """Say which values are allowed."""
        if math.isinf(self.low) and math.isinf(self.high):
            return "finite"
        low = "above" if self.above else "at least"
        if math.isinf(self.high):
            return f"finite and {low} {self.low:g}"
        return f"{low} {self.low:g} and at most {self.high:g}"

    def contains(self, value: float) -> bool:
        """Whether a number lies in the domain; nan never does."""
        above_low = value > self.low if self.above else value >= self.low
        return math.isfinite(value) and above_low and value <= self.high


def option(
    name: str,
    help: str,  # noqa: A002 - the command line's word
    parse: Callable[[str], Any] = text,
    *,
    default: Any,  # noqa: ANN401
    shown: str | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
) -> Any:  # noqa: ANN401 - dataclasses.field is typed as what it stands for
    """Declare a dataclass field together with its command-line option."""
    shown = str(default) if shown is None else shown
    return field(
        default=default,
        metadata={"option": Option(name, help, parse, shown, low, high, above)},
    )


class Optioned:
    """What a dataclass of such fields can do: check its values, and be read from text."""

    __slots__ = ()

    @classmethod
    def options(cls) -> dict[str, Option]:
        """Return the command-line option of each field that has one, by field name."""
        fields = dataclasses.fields(cls)  # type: ignore[arg-type]
        return {f.name: f.metadata["option"] for f in fields if "option" in f.metadata}

    @classmethod
    def from_text(cls, given: Mapping[str, str | bool | None]) -> Self:
        """Build from command-line values by field name; what is not given or None is the default.

        Raises
        ------
        ScenarioError
            If a value cannot be read, or lies outside its domain.
        """
        values: dict[str, Any] = {}
        for name, spec in cls.options().items():
            raw = given.get(name)
            if isinstance(raw, bool):
                values[name] = raw
            elif raw is not None and not (spec.default == "default" and raw == "default"):
                try:
                    values[name] = spec.parse(raw)
                except ScenarioError as error:
                    raise ScenarioError(f"{spec.name} takes {error}, got {raw!r}") from None
        return cls(**values)

    def check_domains(self) -> None:
        """Check every number against its field's domain.

        Raises
        ------
        ScenarioError
            If one lies outside it.
        """
        for name, spec in self.options().items():
            value = getattr(self, name)
            numbers = value if isinstance(value, tuple) else (value,)
            for one in numbers:
                is_number = isinstance(one, int | float) and not isinstance(one, bool)
                if is_number and not spec.contains(one):
                    raise ScenarioError(f"{spec.name} must be {spec.domain()}, got {one!r}")

"""A field that knows its command-line option: how it is written, and which values it may hold.

What is declared once here serves the command line, the recording and a sweep alike.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, Self, Union, get_args, get_origin, get_type_hints

from pipeline.errors import ScenarioError
from pipeline.kinds import TEXT, Kind
from pipeline.messages import Message


def fraction(value: float) -> str:
    """Write 1/240 where a float is 1/240, else the number."""
    if not math.isfinite(value):
        return str(value)
    exact = Fraction(value).limit_denominator(1_000_000)
    plain = float(f"{value:.9g}") == value
    if float(exact) == value and (exact.denominator > 10 or not plain):
        return str(exact)
    return f"{value:.9g}"


def counted(number: int, thing: str, things: str = "") -> Message:
    """Return how many there are of a thing: 1 sample, 1,000 samples."""
    noun = Message(thing if number == 1 else things or f"{thing}s")
    noun.template = thing  # what is translated: Japanese, the only translation, has no plural
    return Message("{number:,} {noun}", number=number, noun=noun)


LARGE = 1e6
"""From here on a number is written in powers of ten."""


def decimals(value: float, places: int, sign: str = "") -> str:
    """Write a number with so many decimals; a large one as engineers do: 9.81e9, -12.5e6.

    `sign` is that of Python's formats: `+` writes one before every number. What is nothing in so
    many decimals has no minus.
    """
    if abs(value) >= LARGE:
        return engineering(value, sign)
    return f"{round(value, places) + 0.0:{sign}.{places}f}"


def engineering(value: float, sign: str = "") -> str:
    """Write a number in six digits and powers of 1000: 9.81e9, 12.5e3, 0."""
    rounded = float(f"{value:.6g}")
    power = 3 * math.floor(math.log10(abs(rounded)) / 3) if rounded else 0
    return f"{rounded / 10.0**power:{sign}.6g}" + (f"e{power}" if power else "")


def exact(value: object) -> str:
    """Write a value so that reading it gives the same to the last bit: the other way of parsing."""
    return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)


# -- one field: its option, its domain ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Option:
    """How a field is given on the command line, and which numbers it may hold."""

    name: str
    help: str
    kind: Kind
    default: str
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    """Whether `low` itself is excluded."""
    left_to: str = "the engine's own"
    """Whose value it is where none is given and the default is `default`."""
    choices: tuple[str, ...] = ()
    """The only texts it takes; empty where there are too many to list."""

    @property
    def is_left(self) -> bool:
        """Whether somebody else's value is the default."""
        return self.default == "default"

    @property
    def is_flag(self) -> bool:
        """Whether giving the option switches the field off."""
        return self.name.startswith("--no-")

    def read(self, raw: str) -> Any:  # noqa: ANN401
        """Read one value; `default` is None where the engine has a value of its own.

        Raises
        ------
        ScenarioError
            If the text cannot be read.
        """
        if self.is_left and raw == "default":
            return None
        try:
            return self.kind.read(raw)
        except ScenarioError as error:
            raise ScenarioError(f"{self.name} takes {error}, got {shown(raw)}") from None

    def written(self, value: object) -> str:
        """Write a value for people; a fraction only where the default is one, as 1/240."""
        if value is None:
            return "default"
        if isinstance(value, list | tuple):
            return self.kind.joined.join(map(self.written, value))
        if isinstance(value, float):
            return fraction(value) if "/" in self.default else f"{value:.9g}"
        return str(value)

    def read_list(self, raw: str) -> tuple[Any, ...]:
        """Read values separated by commas, or by semicolons where values have commas of their own.

        Raises
        ------
        ScenarioError
            If one of them cannot be read, or lies outside the domain.
        """
        by_semicolon = bool(self.kind.components) or ";" in raw
        parts = raw.split(";" if by_semicolon else ",")
        values = tuple(self.read(part.strip(" \t")) for part in parts)
        for value in values:
            self.check(value)
        return values

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
        return above_low and value <= self.high and abs(value) <= sys.float_info.max

    def check(self, value: object) -> None:
        """Make sure that the numbers in a value lie in the domain.

        Raises
        ------
        ScenarioError
            If one lies outside it.
        """
        for one in value if isinstance(value, tuple) else (value,):
            is_number = isinstance(one, int | float) and not isinstance(one, bool)
            if is_number and not self.contains(one):
                raise ScenarioError(
                    f"{self.name} must be {self.domain()}, got {shown(one)}{self._meant(one)}"
                )

    def _meant(self, value: float) -> str:
        """Ask whether a frequency was given where a fraction belongs: 240 for 1/240."""
        if "/" not in self.default or not value > self.high or not self.contains(1 / value):
            return ""
        return f"; did you mean 1/{value:.9g}?"


def option(
    name: str,
    help: str,  # noqa: A002 - the command line's word
    kind: Kind = TEXT,
    *,
    default: Any,  # noqa: ANN401
    shown: str | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
    left_to: str = "the engine's own",
    choices: tuple[str, ...] = (),
) -> Any:  # noqa: ANN401 - dataclasses.field is typed as what it stands for
    """Declare a dataclass field together with its command-line option."""
    shown = str(default) if shown is None else shown
    return field(
        default=default,
        metadata={"option": Option(name, help, kind, shown, low, high, above, left_to, choices)},
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
            elif raw is not None:
                values[name] = spec.read(raw)
        return cls(**values)

    @classmethod
    def checked(cls, name: str, given: object) -> Any:  # noqa: ANN401
        """Return a field's value, its type and domain checked; a whole number becomes a float.

        Raises
        ------
        ScenarioError
            If it is of another type, or lies outside its domain.
        """
        spec, hint = cls.options()[name], _hints(cls)[name]  # type: ignore[arg-type]
        try:
            value = _of_kind(given, hint)
        except (TypeError, OverflowError):
            raise ScenarioError(f"{spec.name} must be {_kind(hint)}, got {shown(given)}") from None
        spec.check(value)
        return value

    @classmethod
    def listed(cls, name: str, given: object) -> tuple[Any, ...]:
        """Return several values of a field: text as the command line's, a list, or one value.

        Raises
        ------
        ScenarioError
            If one of them is not one.
        """
        if isinstance(given, str):
            return cls.options()[name].read_list(given)
        values = given if isinstance(given, Iterable) and not isinstance(given, tuple) else [given]
        return tuple(cls.checked(name, value) for value in values)

    def check_domains(self) -> None:
        """Check every value's type and domain; a whole number becomes a float where one belongs.

        Raises
        ------
        ScenarioError
            If one is of another type, or lies outside its domain.
        """
        for name in self.options():
            value = self.checked(name, getattr(self, name))
            object.__setattr__(self, name, value)  # frozen for everybody else


UNIONS = (UnionType, Union)
"""Both are of `X | None`: the second where X is a Literal."""

# -- types ----------------------------------------------------------------------------------------


def shown(value: object) -> str:
    """Return a value as an error quotes it: not longer than a line takes."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write out a number of some thousand digits
        text = "a number too long to write"
    return text if len(text) <= 120 else f"{text[:100]}…{text[-10:]}"


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:  # noqa: ANN401 - a class; mypy doubts its hash
    return get_type_hints(kind)  # evaluates every annotation, in ten times what the checks take


def _of_kind(value: Any, hint: Any) -> Any:  # noqa: ANN401
    """Return a value as the type that a field is declared with; TypeError if it is of another."""
    arguments = get_args(hint)
    if get_origin(hint) is Literal:
        if value in arguments:
            return value
    elif get_origin(hint) in UNIONS:
        if value is None and NoneType in arguments:
            return None
        for argument in arguments:
            with contextlib.suppress(TypeError):
                return _of_kind(value, argument)
    elif get_origin(hint) is tuple:
        if isinstance(value, tuple | list) and len(value) == len(arguments):
            return tuple(map(_of_kind, value, arguments))
    elif hint in (bool, str) or isinstance(value, bool):  # which is an int to Python, not to us
        if isinstance(value, hint) and isinstance(value, bool) == (hint is bool):
            return value
    elif isinstance(value, Real if hint is float else Integral):
        return hint(value)
    raise TypeError


def _kind(hint: Any) -> str:  # noqa: ANN401
    arguments = get_args(hint)
    if get_origin(hint) is Literal:
        return " or ".join(arguments)
    if get_origin(hint) in UNIONS:
        return " or ".join(_kind(argument) for argument in arguments if argument is not NoneType)
    if get_origin(hint) is tuple:
        return f"{len(arguments)} times {_kind(arguments[0])}"
    return {float: "a number", int: "a whole number", bool: "True or False", str: "text"}[hint]

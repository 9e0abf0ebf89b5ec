"""Dataclass fields with their command-line option: text form, and allowed values.

One declaration serves the command line, the recording and sweeps.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from fractions import Fraction
from numbers import Integral, Real
from typing import Any, Self

from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.option_types import TEXT, OptionType


def fraction(value: float) -> str:
    """Format a value as a fraction such as 1/240 if it equals that float, otherwise as a number."""
    if not math.isfinite(value):
        return str(value)
    exact = Fraction(value).limit_denominator(1_000_000)
    plain = float(f"{value:.9g}") == value
    if float(exact) == value and (exact.denominator > 10 or not plain):
        return str(exact)
    return f"{value:.9g}"


def counted(number: int, thing: str, things: str = "") -> Message:
    """Return a number with its noun: 1 sample, 1,000 samples."""
    noun = Message(thing if number == 1 else things or f"{thing}s")
    noun.template = thing  # what is translated: Japanese, the only translation, has no plural
    return Message("{number:,} {noun}", number=number, noun=noun)


def alternatives(texts: Iterable[str]) -> str:
    """Join texts with `or`: A, B or C."""
    return functools.reduce(lambda a, b: Message("{one} or {other}", one=a, other=b), texts)


def all_of(texts: Iterable[str]) -> str:
    """Join texts with `and`: A, B and C."""
    return functools.reduce(lambda a, b: Message("{one} and {other}", one=a, other=b), texts)


LARGE = 1e6
"""Smallest number that is written in powers of ten."""


def decimals(value: float, places: int, sign: str = "") -> str:
    """Write a number with a given number of decimals; a large one as 9.81e9 or -12.5e6.

    `sign` is as in Python's format strings: `+` gives every number a sign. A number that rounds to
    zero has no minus sign.
    """
    if abs(value) >= LARGE:
        return engineering(value, sign)
    return f"{round(value, places) + 0.0:{sign}.{places}f}"


def engineering(value: float, sign: str = "") -> str:
    """Write a number in six digits and powers of 1000: 9.81e9, 12.5e3, 0, inf."""
    if not math.isfinite(value):
        return f"{value:{sign}}"
    rounded = float(f"{value:.6g}")
    power = 3 * math.floor(math.log10(abs(rounded)) / 3) if rounded else 0
    return f"{rounded / 10.0**power:{sign}.6g}" + (f"e{power}" if power else "")


def exact(value: object) -> str:
    """Write a value so that parsing the text gives the same value to the last bit."""
    return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)


_NUMBERS: dict[type, type] = {float: Real, int: Integral}

# -- one field: its option, its domain ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Option:
    """The command-line option of a field, and the numbers that it allows."""

    name: str
    help: str
    kind: OptionType
    default: str
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    """Whether the value must be above `low`, which is then excluded."""
    left_to: str = "the engine's own"
    """Source of the value if the default is `default`: the engine or the URDF."""
    choices: tuple[str, ...] = ()
    """The only allowed texts; empty if any text is allowed, or there are too many to list."""

    @property
    def is_left(self) -> bool:
        """True if the default value is left to the engine or the URDF."""
        return self.default == "default"

    @property
    def is_flag(self) -> bool:
        """True if the option takes no value: giving the option switches the field off."""
        return self.name.startswith("--no-")

    def read(self, raw: str) -> Any:  # noqa: ANN401
        """Parse one value; `default` becomes None if the engine has a value of its own.

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
            raise ScenarioError(
                "{option} takes {what}, got {value}",
                option=self.name,
                what=error.in_options,
                value=shown(raw),
            ) from None

    def written(self, value: object) -> str:
        """Format a value for reading; as a fraction such as 1/240 only if the default is one."""
        if value is None:
            return "default"
        if isinstance(value, list | tuple):
            return self.kind.joined.join(map(self.written, value))
        if isinstance(value, float):
            return fraction(value) if "/" in self.default else f"{value:.9g}"
        return str(value)

    def read_list(self, raw: str) -> tuple[Any, ...]:
        """Parse values separated by commas, or by semicolons if each value contains commas itself.

        Raises
        ------
        ScenarioError
            If a value cannot be parsed, or is outside the domain.
        """
        by_semicolon = bool(self.kind.components) or ";" in raw
        parts = raw.split(";" if by_semicolon else ",")
        values = tuple(self.read(part.strip(" \t")) for part in parts)
        for value in values:
            self.check(value)
        return values

    def domain(self) -> Message:
        """Describe the allowed values."""
        low, high = self.low, self.high
        if math.isinf(low) and math.isinf(high):
            return Message("finite")
        if math.isinf(high):
            if self.above:
                return Message("finite and above {low:g}", low=low)
            return Message("finite and at least {low:g}", low=low)
        if self.above:
            return Message("above {low:g} and at most {high:g}", low=low, high=high)
        return Message("at least {low:g} and at most {high:g}", low=low, high=high)

    def contains(self, value: float) -> bool:
        """Return whether a number is in the domain; nan never is."""
        above_low = value > self.low if self.above else value >= self.low
        return above_low and value <= self.high and abs(value) <= sys.float_info.max

    def check(self, value: object) -> None:
        """Check that the numbers in a value are in the domain.

        Raises
        ------
        ScenarioError
            If a number is outside the domain.
        """
        for part in value if isinstance(value, tuple) else (value,):
            is_number = isinstance(part, int | float) and not isinstance(part, bool)
            if is_number and not self.contains(part):
                raise self._outside(part)

    def accepted(self, value: Any) -> Any:  # noqa: ANN401
        """Check a value's type and domain, and return it; an integer becomes a float where needed.

        Raises
        ------
        ScenarioError
            If the value has another type, or is outside its domain.
        """
        if value is None and self.is_left:
            return None
        lengths, of = self.kind.lengths, bool if self.is_flag else self.kind.of
        several = isinstance(value, tuple | list) and len(value) in lengths
        parts = value if several else [value]
        is_of = all(isinstance(part, _NUMBERS.get(of, of)) for part in parts)
        bools = any(isinstance(part, bool) for part in parts)  # which are ints to Python, not to us
        chosen = not self.choices or value in self.choices
        try:
            if several != bool(lengths) or not is_of or bools != (of is bool) or not chosen:
                raise TypeError
            made = tuple(map(of, parts)) if several else of(value)
        except (TypeError, OverflowError):
            raise outside(self.name, self._type_in_words(), value) from None
        self.check(made)
        return made

    def _type_in_words(self) -> str:
        if self.choices or self.is_flag:
            return alternatives(self.choices or ("True", "False"))
        one = {float: Message("a number"), int: Message("a whole number"), str: Message("text")}[
            self.kind.of
        ]
        times = (Message("{n} times {kind}", n=n, kind=one) for n in self.kind.lengths)
        return alternatives(times) if self.kind.lengths else one

    def _outside(self, value: float) -> ScenarioError:
        """Return the error for a number out of range; for 240 it asks whether 1/240 was meant."""
        error = outside(self.name, self.domain(), value)
        if "/" in self.default and value > self.high and self.contains(1 / value):
            return ScenarioError(
                "{error}; did you mean 1/{value:.9g}?", error=error.in_options, value=value
            )
        return error


def option(
    name: str,
    help: str,  # noqa: A002 - the command line's word
    kind: OptionType = TEXT,
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
    """Base of dataclasses whose fields are options: checks and parses their values."""

    __slots__ = ()

    @classmethod
    def options(cls) -> dict[str, Option]:
        """Return the command-line option of each field that has one, by field name."""
        return _options(cls)  # type: ignore[arg-type]

    @classmethod
    def from_text(cls, given: Mapping[str, str | bool | None]) -> Self:
        """Build an instance from command-line texts by field name; absent or None means default.

        Raises
        ------
        ScenarioError
            If a value cannot be read, or is outside its domain.
        """
        values: dict[str, Any] = {
            name: spec.read(raw) if isinstance(raw, str) else raw
            for name, spec in cls.options().items()
            if (raw := given.get(name)) is not None
        }
        return cls(**values)

    @classmethod
    def listed(cls, name: str, given: object) -> tuple[Any, ...]:
        """Return a list of values for a field, from command-line text, a list, or a single value.

        Raises
        ------
        ScenarioError
            If a value is invalid.
        """
        option = cls.options()[name]
        if isinstance(given, str):
            return option.read_list(given)
        values = given if isinstance(given, Iterable) and not isinstance(given, tuple) else [given]
        return tuple(map(option.accepted, values))

    def check_domains(self) -> None:
        """Check every field's type and domain; integers become floats where the field is a float.

        Raises
        ------
        ScenarioError
            If a value has another type, or is outside its domain.
        """
        for name, option in self.options().items():  # the dataclass is frozen
            object.__setattr__(self, name, option.accepted(getattr(self, name)))


def shown(value: object) -> str:
    """Format a value for an error message, shortened to fit in a line."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write out a number of some thousand digits
        return Message("a number too long to write")
    return text if len(text) <= 120 else f"{text[:100]}…{text[-10:]}"


def outside(option: str, domain: str, value: object) -> ScenarioError:
    """Return the error for a value of the wrong type or out of range."""
    return ScenarioError(
        "{option} must be {domain}, got {value}", option=option, domain=domain, value=shown(value)
    )


@functools.cache
def _options(kind: Any) -> dict[str, Option]:  # noqa: ANN401 - as below
    return {f.name: f.metadata["option"] for f in fields(kind) if "option" in f.metadata}

"""Turns the fields of a command's dataclass into Python arguments and command-line options.

A field's type is annotated with its option, whose help text serves both. Options that only the
command line has, such as the format of output, are class variables; arguments that only Python has
are annotated with a text instead of an option.
"""

from __future__ import annotations

import functools
import inspect
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, ParamSpec, TypeVar, get_args, get_origin

P = ParamSpec("P")
Asked = TypeVar("Asked")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class TypedOption:
    """The option or positional argument that corresponds to a field, with its type."""

    help: str
    metavar: str = ""
    """Placeholder of the option's value in the help; empty for a flag."""
    names: tuple[str, ...] = ()
    """Names of the option; by default the field's name without its unit."""
    is_argument: bool = False
    read: Callable[[Any], Any] | None = None
    """Function that parses the typed text, if the type does not determine how."""
    default: Any = ...
    """Default on the command line, if it differs from the default in Python."""


def takes(metavar: str, text: str, *names: str, **how: Any) -> TypedOption:  # noqa: ANN401
    """Return an option that takes a value, such as `--out FILE`."""
    return TypedOption(text, metavar, names, **how)


def flag(text: str, *names: str) -> TypedOption:
    """Return an option without a value, such as `--force`."""
    return TypedOption(text, "", names)


def argument(metavar: str, text: str, **how: Any) -> TypedOption:  # noqa: ANN401
    """Return a positional argument."""
    return TypedOption(text, metavar, is_argument=True, **how)


@dataclass(frozen=True, slots=True)
class VerbParameter:
    """A field of a command's dataclass, as an option or argument."""

    name: str
    option: TypedOption
    """The option; for an argument that only Python has, its help text alone."""
    is_typed: bool
    """Whether the command line has this option."""
    in_python: bool
    kind: Any
    """The type of the value, or of each value in a list: `bool`, `int`, `float`, `str`, `Path` or a
    `Literal`."""
    several: bool
    default: Any
    """Default in Python; `MISSING` without a default."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the option, such as `--out` and `-o`."""
        plain = self.name.removesuffix("_s").removesuffix("_m").replace("_", "-")
        return () if self.option.is_argument else self.option.names or (f"--{plain}",)

    @property
    def is_inverse(self) -> bool:
        """True if the option sets the field to False."""
        return self.names != () and self.names[0].startswith("--no-")


def parameters_of(verb: type) -> dict[str, VerbParameter]:
    """Return the parameters of a command, by name: its own first, then shared ones."""
    hints: dict[str, Any] = {}
    for each in verb.__mro__:
        hints |= {n: h for n, h in inspect.get_annotations(each).items() if n not in hints}
    return {name: _parameter(verb, name, hint) for name, hint in hints.items() if name != "_"}


def _parameter(verb: type, name: str, hint: Any) -> VerbParameter:  # noqa: ANN401
    in_python = get_origin(hint) is not ClassVar
    annotated = hint if in_python else get_args(hint)[0]
    of, (said,) = annotated.__origin__, annotated.__metadata__
    is_typed = isinstance(said, TypedOption)
    kinds = [*_kinds(of)]
    return VerbParameter(
        name,
        said if is_typed else TypedOption(said),
        is_typed,
        in_python,
        next((kind for kind in (Path, float, int, bool) if kind in kinds), kinds[0]),
        Sequence in (get_origin(of), *map(get_origin, get_args(of))),
        getattr(verb, name, MISSING),
    )


def _kinds(hint: Any) -> Iterator[Any]:  # noqa: ANN401
    """Yield the basic types that a type hint consists of."""
    if get_origin(hint) is Literal or not get_args(hint):
        yield hint
    else:
        for each in get_args(hint):
            yield from _kinds(each)


def takes_those_of(
    verb: Callable[P, Asked],
) -> Callable[[Callable[[Asked], Result]], Callable[P, Result]]:
    """Return a decorator: a function of a command's dataclass takes the fields as arguments."""

    def decorated(do: Callable[[Asked], Result]) -> Callable[P, Result]:
        @functools.wraps(do)
        def asked(*given: P.args, **options: P.kwargs) -> Result:
            return do(verb(*given, **options))

        asked.__signature__ = inspect.signature(verb)  # type: ignore[attr-defined]
        asked.__doc__ = "\n".join(_documented(do.__doc__ or "", verb))
        return asked

    return decorated


def _documented(text: str, verb: Any) -> Iterator[str]:  # noqa: ANN401
    """Yield the lines of a function's docstring: description, parameters, errors."""
    about, errors, raised = inspect.cleandoc(text).partition("\n\nRaises\n")
    yield from (about, "", "Parameters", "----------")
    for parameter in parameters_of(verb).values():
        if parameter.in_python:
            yield parameter.name
            yield textwrap.indent(textwrap.fill(parameter.option.help, 92), "    ")
    if errors:
        yield f"{errors}{raised}".removeprefix("\n")

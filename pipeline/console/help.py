"""Help as plain text, laid out alike for the list of commands and for each command.

Loading what draws boxes would take longer than everything else that `drop --help` does. The
reference in the documents is written from the same lines.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from difflib import get_close_matches
from itertools import chain
from typing import Any

import typer
from typer import completion
from typer.core import TyperCommand, TyperGroup
from typer.models import CommandFunctionType

from pipeline.console.output import WIDTH, beside, wants_colour
from pipeline.errors import ScenarioError

COLUMN = 28
"""Where what an option means begins."""
OPTIONS = "Options"
"""The group of what is a command's own."""
MORE = "drop COMMAND --help shows the options of a command, and an example."
SHELLS = ("bash", "zsh", "fish")


class App(typer.Typer):
    """The command line; every command's help is plain text."""

    def command(
        self,
        name: str | None = None,
        *,
        cls: type[TyperCommand] | None = None,
        **how: Any,  # noqa: ANN401 - handed on
    ) -> Callable[[CommandFunctionType], CommandFunctionType]:
        """Declare a command."""
        return super().command(name, cls=cls or Command, **how)


class Command(TyperCommand):
    """A command whose help is plain text."""

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write the help: what it does, its options in their groups, an example."""
        formatter.write("\n".join(_page(self, ctx)))


class Commands(TyperGroup):
    """The list of commands; what is no command is answered with the nearest."""

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write where to start, the commands with their first lines, and the options."""
        said = {name: (one.help or "").partition("\n")[0] for name, one in self.commands.items()}
        column = max(map(len, said)) + 4
        listed = (beside(f"  {name}", words, column, _width()) for name, words in said.items())
        first = [self.epilog or "", "", _heading("Commands"), *chain(*listed), "", MORE, ""]
        formatter.write("\n".join(_page(self, ctx, first)))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401
        """Return the command that is meant, or say which there are."""
        name = args[0]
        if name not in self.commands and not name.startswith("-"):
            near = get_close_matches(name, self.commands, n=1)
            meant = f", did you mean {near[0]!r}? The" if near else "; the"
            known = ", ".join(self.commands)
            ctx.fail(f"no such command {name!r}{meant} commands are {known}")
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401
        """Read the options; those of completion may name a shell, else it is the one around us."""
        if len(args) > 1 and args[0] in _COMPLETION:
            if args[1] not in SHELLS:
                raise ScenarioError(f"{args[0]} takes {', '.join(SHELLS)}, got {args[1]!r}")
            _COMPLETION[args[0]](ctx, None, args[1])
        return super().parse_args(ctx, args)


_COMPLETION: dict[str, Callable[..., Any]] = {
    "--install-completion": completion.install_callback,
    "--show-completion": completion.show_callback,
}


# -- the page -------------------------------------------------------------------------------------


def _page(command: Any, ctx: Any, first: Iterable[str] = ()) -> Iterator[str]:  # noqa: ANN401
    """Yield the lines of a command's help; a group says its epilog first, a command last."""
    params, width = command.get_params(ctx), _width()
    ours_first = not ctx.allow_interspersed_args and not first
    called = usage(
        ctx.command_path, params, sub="COMMAND" if first else "", options_first=ours_first
    )
    yield from [called, ""]
    for paragraph in command.help.split("\n\n"):
        yield from [textwrap.fill(" ".join(paragraph.split()), width), ""]
    yield from first
    for title, ones in groups(params).items():
        yield _heading(title)
        yield from (option(one, width) for one in ones)
        yield ""
    if not first:
        yield command.epilog


def _width() -> int:
    return max(50, min(WIDTH, shutil.get_terminal_size().columns))


def _heading(title: str) -> str:
    return f"\x1b[1m{title}:\x1b[0m" if wants_colour(sys.stdout) else f"{title}:"


# -- one option -----------------------------------------------------------------------------------


def usage(
    command: str, params: Iterable[Any], sub: str = "", *, options_first: bool = False
) -> str:
    """Return how a command is called: what it must be given, then what it may."""
    wanted = [call_of(one) for one in params if _is_argument(one) or one.required]
    if options_first:
        return " ".join(["Usage:", command, "[OPTIONS]", *wanted])
    return " ".join(["Usage:", command, *wanted, *([sub] if sub else []), "[OPTIONS]"])


def groups(params: Iterable[Any]) -> dict[str, list[Any]]:
    """Return options by the title of their group; a command's own come first."""
    found: dict[str, list[Any]] = {OPTIONS: []}
    for one in params:
        found.setdefault(getattr(one, "rich_help_panel", None) or OPTIONS, []).append(one)
    return found


def option(one: Any, width: int = WIDTH) -> str:  # noqa: ANN401
    """Return an option or argument and what it means, the meaning in a column of its own."""
    said = one.help.replace("\\[", "[")
    if one.required:
        said += " [required]"
    elif not (one.default is None or one.default is False):
        shown = f"{one.default:g}" if isinstance(one.default, float) else one.default
        said += f" [default: {shown}]"
    # What stands in brackets stays in one line.
    said = re.sub(r"\[default: [^]]*\]", lambda found: found[0].replace(" ", "\xa0"), said)
    return "\n".join(beside(f"  {call_of(one)}", said, COLUMN, width)).replace("\xa0", " ")


def call_of(one: Any) -> str:  # noqa: ANN401
    """Return how an option is given: with a word for its value, unless it is a flag."""
    if _is_argument(one):
        return str(one.metavar)
    if one.is_flag:
        return str(one.opts[0])
    return f"{one.opts[0]} {one.metavar or _WORDS[one.type_descriptor.annotation]}"


_WORDS = {float: "NUMBER", int: "N", str: "TEXT"}


def _is_argument(one: Any) -> bool:  # noqa: ANN401
    return not one.opts[0].startswith("-")

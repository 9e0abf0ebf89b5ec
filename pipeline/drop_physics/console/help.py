"""Format help as plain text, with options in groups; the reference in docs/ has the same text.

By default, Typer draws boxes around the options; loading the library that does so takes longer than
the rest of `drop --help`.
"""

from __future__ import annotations

import copy
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import typer
from typer import completion
from typer._click.core import Command
from typer._coercion import RuntimeParam
from typer.core import TyperCommand, TyperGroup
from typer.models import CommandFunctionType

from drop_physics.console import output
from drop_physics.errors import ScenarioError
from drop_physics.messages import joined, shell_command

SCRIPT = "SCRIPT.py"
"""Name of the command that handles a command line that begins with a script."""
GROUPS = OWN, BOX, RECORDINGS = "Your own script", "The falling box", "Recordings"
"""Groups of commands, in the order in which help lists them."""
SHELLS = ("bash", "zsh", "fish")
FOREIGN = (".rrd", ".ipynb")
"""Suffixes of files that are not scripts, for which the script command prints the right command."""
OURS = ("--version", "--help", "-h")
"""Options of `drop` itself, before any command."""
RECORDED = (SCRIPT, "record", "analyze")
"""Commands that may handle a command line that begins with a script."""


class App(typer.Typer):
    """The command-line app, whose commands list their options in groups."""

    def command(
        self,
        name: str | None = None,
        *,
        cls: type[TyperCommand] | None = None,
        **how: Any,  # noqa: ANN401 - handed on
    ) -> Callable[[CommandFunctionType], CommandFunctionType]:
        """Declare a command."""
        return super().command(name, cls=cls or HelpedCommand, **how)

    def __call__(self, *args: Any, **how: Any) -> Any:  # noqa: ANN401 - handed on
        """Run the typed command, without creating the other commands."""
        first = "".join(sys.argv[1:2])
        wanted = RECORDED if _is_of_script(first) else (first,)
        few = copy.copy(self)
        few.registered_commands = [
            command
            for command in self.registered_commands
            if (command.name or getattr(command.callback, "__name__", None)) in wanted
        ] or self.registered_commands
        return super(App, few).__call__(*args, **how)


class Plain(RuntimeParam):
    """A parameter passed on as typed: for texts and paths, Typer would load pydantic."""

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:  # noqa: ANN401 - of any type
        """Convert a parameter's value; Typer checks the types of values that are not text."""
        kind, several = self.annotation, param.multiple or param.nargs == -1
        if value is None:
            return () if several else None
        texts = value if several else [value]
        is_default = self.parameter_info.parser is not None and not isinstance(value, str)
        if is_default or value in get_args(kind):  # of a few texts, one
            return value
        if all(isinstance(text, str) for text in texts):
            if kind in (str, list[str]):
                return value
            if kind in (Path, list[Path]) and not any(map(_is_unreadable, texts)):
                return [*map(Path, texts)] if several else Path(value)
        param._runtime_param = None
        return param.get_runtime_param().coerce(value, param=param, ctx=ctx)

    def _coerce_value(self, value: Any, param: Any, ctx: Any) -> Any:  # noqa: ANN401
        return self.coerce(value, param, ctx)


def _is_unreadable(path: str) -> bool:
    return Path(path).exists() and not os.access(path, os.R_OK)


class TakesPlainly(Command):
    """Base of commands and command groups whose parameters are `Plain`."""

    def get_params(self, ctx: Any) -> Any:  # noqa: ANN401 - Typer's
        """Return the command's parameters."""
        params: list[Any] = super().get_params(ctx)
        for param in params:
            its = param.type_descriptor
            param._runtime_param = param._runtime_param or Plain(its.parameter_info, its.annotation)
        return params


class HelpedCommand(TakesPlainly, TyperCommand):
    """A command whose help lists arguments, its own options, then each `rich_help_panel`."""

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - Typer's
        """Run the command; with `--json`, errors are also printed as JSON."""
        asked = ctx.params.get("json") or ctx.params.get("output_format") == "json"
        output.errors_as_json = bool(asked)
        return super().invoke(ctx)

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write a help section for each group of options."""
        sections: dict[str, list[tuple[str, str]]] = {}
        params: list[Any] = self.get_params(ctx)  # options and arguments, which share few types
        for param in params:
            is_argument = param.param_type_name == "argument"
            title = "Arguments" if is_argument else param.rich_help_panel or "Options"
            record = (param.metavar, param.help) if is_argument else param.get_help_record(ctx)
            sections.setdefault(title, []).append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)


class HelpedCommands(TakesPlainly, TyperGroup):
    """The commands, in groups; a script in place of a command is recorded and analyzed."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401, ARG002
        """Write a help section for each group of commands, named by their `rich_help_panel`."""
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in GROUPS}
        for name, command in sorted(self.commands.items(), key=lambda each: each[0] != SCRIPT):
            title = getattr(command, "rich_help_panel")  # noqa: B009 - of Typer's commands only
            sections[title].append((name, command.get_short_help_str(formatter.width)))
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401
        """Return the command and its arguments; for a script, the whole line as arguments."""
        if _is_of_script(args[0]):
            return SCRIPT, self.commands[SCRIPT], args
        if args[0] not in self.commands and Path(args[0]).is_file():
            if Path(args[0]).suffix in FOREIGN:
                return SCRIPT, self.commands[SCRIPT], args
            raise ScenarioError(
                "no such command {path!r}; a script whose name does not end in .py is recorded "
                "with: {command}",
                path=args[0],
                command=shell_command("drop", "record", Path(args[0])),
            )
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401
        """Parse the options; completion options may name a shell, by default the current one."""
        if len(args) > 1 and args[0] in _COMPLETION:
            if args[1] not in SHELLS:
                raise ScenarioError(
                    "{option} takes {shells}, got {shell!r}",
                    option=args[0],
                    shells=joined(", ", SHELLS),
                    shell=args[1],
                )
            _COMPLETION[args[0]](ctx, None, args[1])
        if args and _is_of_script(args[0]):
            args = ["--", *args]  # whatever they are, they are the script's or its verb's
        return super().parse_args(ctx, args)


def _is_of_script(word: str) -> bool:
    """Return whether a line that begins with this word refers to a script."""
    is_option = word.startswith("-") and word not in (*OURS, *_COMPLETION)
    return is_option or word.endswith(".py")


_COMPLETION: dict[str, Callable[..., Any]] = {
    "--install-completion": completion.install_callback,
    "--show-completion": completion.show_callback,
}

"""Help as plain text, options in groups; the reference in docs/ has the same text.

Typer draws boxes around it by default, and loading what draws them would take longer than
everything else that `drop --help` does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer
from typer import completion
from typer.core import TyperCommand, TyperGroup
from typer.models import CommandFunctionType

from drop_physics.errors import ScenarioError
from drop_physics.messages import joined

SCRIPT = "SCRIPT.py"
"""The command of a line that begins with a script."""
GROUPS = OWN, BOX, RECORDINGS = "Your own script", "The falling box", "Recordings"
"""Groups of commands, in the order in which help lists them."""
SHELLS = ("bash", "zsh", "fish")


class App(typer.Typer):
    """The command line; each command lists its options in groups."""

    def command(
        self,
        name: str | None = None,
        *,
        cls: type[TyperCommand] | None = None,
        **how: Any,  # noqa: ANN401 - handed on
    ) -> Callable[[CommandFunctionType], CommandFunctionType]:
        """Declare a command."""
        return super().command(name, cls=cls or HelpedCommand, **how)


class HelpedCommand(TyperCommand):
    """A command whose help lists arguments, its own options, then each `rich_help_panel`."""

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write a section for each group of options."""
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


class HelpedCommands(TyperGroup):
    """The list of commands, by groups; a script in place of a command is recorded and analyzed."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401, ARG002
        """Write a section for each group, which a command names as its `rich_help_panel`."""
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in GROUPS}
        for name, command in self.commands.items():
            title = getattr(command, "rich_help_panel")  # noqa: B009 - of Typer's commands only
            sections[title].append((name, command.get_short_help_str(formatter.width)))
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401
        """Return the command, and its arguments: of a script the whole line."""
        if args[0].endswith(".py"):
            return args[0], self.commands[SCRIPT], args
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401
        """Parse the options; those of completion may name a shell, by default the current one."""
        if len(args) > 1 and args[0] in _COMPLETION:
            if args[1] not in SHELLS:
                raise ScenarioError(
                    "{option} takes {shells}, got {shell!r}",
                    option=args[0],
                    shells=joined(", ", SHELLS),
                    shell=args[1],
                )
            _COMPLETION[args[0]](ctx, None, args[1])
        return super().parse_args(ctx, args)


_COMPLETION: dict[str, Callable[..., Any]] = {
    "--install-completion": completion.install_callback,
    "--show-completion": completion.show_callback,
}

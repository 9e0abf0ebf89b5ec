"""The list of commands as plain text; each command's own help has boxes and colours.

Loading what draws them would take longer than everything else that `drop --help` does.
"""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup


class PlainHelp(TyperGroup):
    """A group of commands whose own help is plain text."""

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write the help with Click's own formatter."""
        self.rich_markup_mode = None
        super().format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write each command with its first line, whole: Click's own would cut it."""
        rows = [(name, (self.commands[name].help or "").partition("\n")[0])
                for name in self.list_commands(ctx)]  # fmt: skip
        with formatter.section("Commands"):
            formatter.write_dl(rows)

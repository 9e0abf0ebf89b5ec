"""Write the reference of the command line: what every `--help` prints."""

from __future__ import annotations

import typer
from typer.testing import CliRunner

from cli import app

_HEAD = """# Commands

*Made by `python docs/regenerate.py`; `drop COMMAND --help` prints the same.*

Results go to standard output, everything else to standard error. Exit codes: 0 done, 1 failed,
2 wrong usage, 3 a check found a difference, 130 stopped by Ctrl-C (143 by SIGTERM). A sweep fails
where one of its runs does; `record` makes its recording whole on Ctrl-C, and exits with 0. With
`--json` standard output is exactly one JSON object: [json.md](json.md) describes it. On a terminal
lines are as wide as that is, from 50 to 100 columns. With `LANG=ja_JP.UTF-8`, or `DROP_LANG=ja`,
results, notes and errors are in Japanese, and so are plots where a Japanese font is installed; help
and JSON stay English.
"""
WIDTH = 90


def made() -> dict[str, str]:
    """Return the page."""
    names = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    sections = [_section("drop"), *(_section("drop", name) for name in names)]
    return {"commands.md": "\n".join([_HEAD, *sections])}


def _section(*call: str) -> str:
    help_ = (
        CliRunner()
        .invoke(app, [*call[1:], "--help"], prog_name="drop", terminal_width=WIDTH)
        .stdout
    )
    return f"## {' '.join(call)}\n\n```text\n{help_.strip()}\n```\n"

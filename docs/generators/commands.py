"""Write the reference of the command line, from the declarations that it is parsed by."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import Any

import typer

from cli import app
from pipeline.console.help import OPTIONS, groups, option, usage

_HEAD = """# Commands

*Made by `python docs/regenerate.py` from the command line itself; `drop COMMAND --help` says the
same.*

Results go to standard output, everything else to standard error. Exit codes: 0 done, 1 failed,
2 wrong usage, 3 a check found a difference. With `--json` standard output is exactly one JSON
object: [json.md](json.md) describes it.
"""


def made() -> dict[str, str]:
    """Return the page."""
    drop: Any = typer.main.get_command(app)
    shared = _shared(drop.commands.values())
    parts = [_HEAD, _section("drop", drop, {})]
    parts += [_section(f"drop {name}", one, shared) for name, one in drop.commands.items()]
    for title, lines in shared.items():
        parts.append(f"## {title}\n\n{_text(lines)}")
    return {"commands.md": "\n".join(parts)}


def _shared(commands: Iterable[Any]) -> dict[str, list[str]]:
    """Return the groups of options that several commands take, and what all of these have of it."""
    found: dict[str, list[str]] = {}
    for command in commands:
        for title, lines in _groups(command).items():
            if title != OPTIONS:
                known = found.setdefault(title, lines)
                found[title] = [line for line in known if line in lines]
    return found


def _groups(command: Any) -> dict[str, list[str]]:  # noqa: ANN401
    """Return what is said of each option, by the title of its group."""
    return {
        title if title == OPTIONS else f"{title.partition(' (')[0]} options": [*map(option, ones)]
        for title, ones in groups(command.params).items()
    }


def _section(call: str, command: Any, shared: dict[str, list[str]]) -> str:  # noqa: ANN401
    found = _groups(command)
    own = [
        one for title, lines in found.items() for one in lines if one not in shared.get(title, [])
    ]
    links = [f"[{title}](#{title.lower().replace(' ', '-')})" for title in found if title in shared]
    paragraphs = [textwrap.fill(one, 100) for one in command.help.split("\n\n")]
    ours_first = not command.context_settings.get("allow_interspersed_args", True)
    called = usage(
        call, command.params, "" if shared else "COMMAND", options_first=ours_first
    ).removeprefix("Usage: ")
    paragraphs.append(_text([called, "", *own]).rstrip())
    if links:
        paragraphs.append(f"And the {' and '.join(links)}.")
    what, _, example = command.epilog.partition(": ")
    return "\n\n".join([f"## {call}", *paragraphs, f"{what}: `{example.strip()}`\n"])


def _text(lines: Iterable[str]) -> str:
    return "\n".join(["```text", *lines, "```", ""])

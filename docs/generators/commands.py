"""Write the reference of the command line, from the declarations that it is parsed by."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from typing import Any

import typer

from cli import app

WIDTH = 80
COLUMN = 28
"""Where what an option means begins."""

_HEAD = """# Commands

*Made by `python docs/regenerate.py` from the command line itself; `drop COMMAND --help` says the
same.*

Results go to standard output, everything else to standard error. Exit codes: 0 done, 1 failed,
2 wrong usage, 3 a check did not hold. With `--json` standard output is exactly one JSON object:
[json.md](json.md) describes it.
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
            if title:
                known = found.setdefault(title, lines)
                found[title] = [line for line in known if line in lines]
    return found


def _groups(command: Any) -> dict[str, list[str]]:  # noqa: ANN401
    """Return what is said of each option, by the title of its group; a command's own have none."""
    groups: dict[str, list[str]] = {"": []}
    for one in command.params:
        panel = (one.rich_help_panel or "").partition(":")[0]
        groups.setdefault(f"{panel} options" if panel else "", []).append(_option(one))
    return groups


def _section(call: str, command: Any, shared: dict[str, list[str]]) -> str:  # noqa: ANN401
    wanted = [_call(one) for one in command.params if _is_argument(one) or one.required]
    groups = _groups(command)
    own = [
        one for title, lines in groups.items() for one in lines if one not in shared.get(title, [])
    ]
    links = [f"[{title}](#{title.lower().replace(' ', '-')})" for title in groups if title]
    paragraphs = [textwrap.fill(one, 100) for one in command.help.split("\n\n")]
    paragraphs.append(_text([" ".join([call, *wanted, "[OPTIONS]"]), "", *own]).rstrip())
    if links:
        paragraphs.append(f"And the {' and '.join(links)}.")
    what, _, example = command.epilog.partition(": ")
    return "\n\n".join([f"## {call}", *paragraphs, f"{what}: `{example}`\n"])


def _text(lines: Iterable[str]) -> str:
    return "\n".join(["```text", *lines, "```", ""])


# -- one option -----------------------------------------------------------------------------------


def _option(one: Any) -> str:  # noqa: ANN401
    """Return an option or argument and what it means, the meaning in a column of its own."""
    said = one.help.replace("\\[", "[")
    if one.required:
        said += " [required]"
    elif not (one.default is None or one.default is False):
        said += f" [default: {one.default}]"
    meaning = textwrap.wrap(said, WIDTH - COLUMN, break_on_hyphens=False, break_long_words=False)
    call = f"  {_call(one)}"
    if len(call) > COLUMN - 2:
        meaning.insert(0, "")
    beside = [call, *[""] * (len(meaning) - 1)]
    return "\n".join(
        f"{left:<{COLUMN}}{line}".rstrip() for left, line in zip(beside, meaning, strict=True)
    )


def _is_argument(one: Any) -> bool:  # noqa: ANN401
    return not one.opts[0].startswith("-")


def _call(one: Any) -> str:  # noqa: ANN401
    """Return how an option is given: with a word for its value, unless it is a flag."""
    if _is_argument(one):
        return str(one.metavar)
    if one.is_flag:
        return str(one.opts[0])
    kind = one.type_descriptor.annotation
    word = one.metavar or {float: "NUMBER", int: "N"}.get(
        kind, re.sub(r"\W", "", str(kind)).upper()
    )
    return f"{one.opts[0]} {word}"

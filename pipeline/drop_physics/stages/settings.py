"""A project's settings: the table `[tool.drop]` in its pyproject.toml."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.rules.choice import NEVER, Choice, level_of, picked

FILE = "pyproject.toml"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_list(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)


KINDS: dict[str, tuple[Callable[[object], bool], Message]] = {
    "select": (_is_list, Message("a list of codes")),
    "ignore": (_is_list, Message("a list of codes")),
    "fail-on": (lambda value: isinstance(value, str), Message("a level")),
    "tolerance": (_is_number, Message("a number of metres")),
}
"""Check of each key's value, and the name of the expected type."""


@dataclass(frozen=True)
class ProjectSettings:
    """The settings table of a project; empty if there is none."""

    path: Path
    table: dict[str, Any]

    @property
    def tolerance_m(self) -> float:
        """Largest accepted difference from a golden recording [m]."""
        return float(self.table.get("tolerance", 0.0))

    def choice(
        self, select: str | None = None, ignore: str | None = None, fail_on: str | None = None
    ) -> Choice:
        """Return which findings to report; command-line options override the project's settings.

        Raises
        ------
        ScenarioError
            If there is no such code, or no such level.
        """
        level = level_of(self.table.get("fail-on", NEVER), self.path)
        return Choice(
            picked(self.table.get("select"), self.table.get("ignore"), self.path),
            picked(_listed(select), _listed(ignore)),
            level if fail_on is None else level_of(fail_on),
        )


def _listed(text: str | None) -> list[str] | None:
    return None if text is None else [each.strip() for each in text.split(",")]


def settings(folder: Path | None = None) -> ProjectSettings:
    """Return the settings in the nearest pyproject.toml, in a folder or above it.

    Raises
    ------
    ScenarioError
        If the file cannot be read, or a value is not allowed for its key.
    """
    start = (folder or Path()).resolve()
    path = next((at / FILE for at in (start, *start.parents) if (at / FILE).is_file()), None)
    if path is None:
        return ProjectSettings(Path(FILE), {})
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        table = tables.get("tool", {}).get("drop", {})
        table.items()
    except AttributeError:
        raise ScenarioError("[tool.drop] must be a table in {path}", path=path) from None
    except (OSError, ValueError) as error:
        raise ScenarioError("{path} cannot be read: {why}", path=path, why=str(error)) from None
    for key, value in table.items():
        if key not in KINDS:
            near = difflib.get_close_matches(key, KINDS, 1, 0.0)[0]
            raise ScenarioError(
                "[tool.drop] in {path} has no {key}; did you mean {near}?",
                path=path,
                key=key,
                near=near,
            )
        takes, kind = KINDS[key]
        if not takes(value):
            raise ScenarioError(
                "{key} in {path} takes {kind}, got {value}",
                key=key,
                path=path,
                kind=kind,
                value=repr(value),
            )
    return ProjectSettings(path, table)

"""The errors `drop` raises on purpose: one line each, with the rule, the value and what to try."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from pipeline.messages import Message

PARAMETERS = {
    "height": "height_m", "timestep": "timestep_s", "duration": "duration_s",
    "gravity": "gravity_m_s2", "velocity": "velocity_m_s", "spin": "spin_rad_s", "mass": "mass_kg",
    "restitution-threshold": "restitution_threshold_m_s", "camera": "view", "size": "size_px",
    "at": "at_s", "tolerance": "tolerance_m", "until-ci": "until_ci_m",
    "no-step": "stepped=False", "no-gravity": "gravity_set=False", "no-floor": "floor=False",
    "no-camera": "camera=None", "no-record": "record=False", "force": "force=True",
    "with-plot": "with_plot=True", "caption": "caption=True", "dark": "dark=True",
}  # fmt: skip
"""Options whose parameter in Python is not the option's name in underscores."""
_OPTION = re.compile(
    r"""(?P<kept>(?<!\w)'[^']*'              # what was given
               |\bdrop\ (?:simulate|analyze|render|run|check|sweep|record|view|info)\ [^;]*
               |\b(?:mkdir|ls|mv|pip|ray)\ [^;]*)
      |--(?P<name>[a-z][a-z-]*[a-z])
       (?:\ (?P<number>-?\d[\d./e+-]*(?<=\d))(?![\w,/]|\.\d) |\ (?P<word>bullet|reduced|tiny)\b)?
    """,
    re.VERBOSE,
)


def in_parameters(message: str) -> str:
    """Say in the names of Python's parameters what is said in those of options."""

    def said(found: re.Match[str]) -> str:
        if found["kept"] is not None:
            return found["kept"]
        name = PARAMETERS.get(found["name"], found["name"].replace("-", "_"))
        if found["number"] is not None:
            return f"{name}={found['number']}"
        return name if found["word"] is None else f"{name}={found['word']!r}"

    return _OPTION.sub(said, message)


class DropError(Exception):
    """Something could not be done; the message says what, and what to do.

    It is a template and the values that it names. It is written with the names of options, as the
    command line prints it. As a text it has the names of parameters, as whoever catches it in
    Python wrote them.
    """

    exit_code = 1

    def __init__(self, template: str, /, **values: object) -> None:
        super().__init__(Message(template, **values) if values else template)

    @property
    def in_options(self) -> str:
        """The message as the command line says it."""
        message: str = self.args[0]
        return message

    def __str__(self) -> str:
        return in_parameters(self.in_options)


class ScenarioError(DropError, ValueError):
    """A value that no drop can be made with: outside its domain, or not readable."""

    exit_code = 2


class RecordingError(DropError):
    """A recording that is missing, damaged, unfinished, or not one of ours."""


class OutputError(DropError):
    """A file that cannot be written where it was asked for."""


def check_suffix(option: str, path: Path, suffixes: Iterable[str]) -> None:
    """Make sure that a file's suffix names a format that can be written.

    Raises
    ------
    ScenarioError
        If it does not.
    """
    *others, last = suffixes
    if path.suffix not in (*others, last):
        allowed = f"{', '.join(others)} or {last}" if others else last
        raise ScenarioError(
            "{option} must end in {allowed}, got {path!r}",
            option=option,
            allowed=allowed,
            path=str(path),
        )

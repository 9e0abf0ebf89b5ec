"""Errors that `drop` raises on purpose, in one line: the rule, the value, and what to do next."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from drop_physics.messages import Message

PARAMETERS = {
    "height": "height_m", "timestep": "timestep_s", "duration": "duration_s",
    "gravity": "gravity_m_s2", "velocity": "velocity_m_s", "spin": "spin_rad_s", "mass": "mass_kg",
    "restitution-threshold": "restitution_threshold_m_s", "camera": "view", "size": "size_px",
    "at": "at_s", "tolerance": "tolerance_m",
    "no-step": "stepped=False", "no-gravity": "gravity_set=False", "no-floor": "floor=False",
    "no-camera": "camera=None", "no-record": "record=False", "force": "force=True",
    "with-plot": "with_plot=True", "caption": "caption=True", "dark": "dark=True",
}  # fmt: skip
"""Parameter names in Python of options whose name differs in more than underscores."""
_OPTION = re.compile(
    r"""(?P<kept>(?<!\w)'[^']*'              # a quoted value
               |\bdrop\ (?:simulate|analyze|render|run|check|sweep|record|view|info)\ [^;]*
               |\b(?:mkdir|ls|mv|pip|ray)\ [^;]*)
      |--(?P<name>[a-z][a-z-]*[a-z])
       (?:\ (?P<number>-?\d[\d./e+-]*(?<=\d))(?![\w,/]|\.\d) |\ (?P<word>bullet|reduced|tiny)\b)?
    """,
    re.VERBOSE,
)


def in_parameters(message: str) -> str:
    """Rewrite the option names in an English message as Python's parameter names."""

    def renamed(match: re.Match[str]) -> str:
        if match["kept"] is not None:
            return match["kept"]
        name = PARAMETERS.get(match["name"], match["name"].replace("-", "_"))
        if match["number"] is not None:
            return f"{name}={match['number']}"
        return name if match["word"] is None else f"{name}={match['word']!r}"

    return _OPTION.sub(renamed, message)


class Stopped(BaseException):
    """Raised when a signal ends the process. Typer catches KeyboardInterrupt, but not this."""


signals: list[int] = []
"""Signals received so far, noted by the command line's handler before it raises `Stopped`."""


def check_signals() -> None:
    """Raise `Stopped` if a signal was received: a library may have swallowed the exception."""
    if signals:
        raise Stopped


NO_MEMORY = Message("there is not enough memory; free some, or see: ulimit -v")


class DropError(Exception):
    """An expected failure, whose message states the reason and what to do next.

    The message is a template with values. It names command-line options; `str` returns it in
    English, with the names of Python's parameters instead.
    """

    exit_code = 1

    def __init__(self, template: str, /, **values: object) -> None:
        whole = isinstance(template, Message) and not values
        super().__init__(template if whole else Message(template, **values))

    @property
    def in_options(self) -> Message:
        """The message as the command line prints it."""
        message: Message = self.args[0]
        return message

    def __str__(self) -> str:
        return in_parameters(self.in_options)


class ScenarioError(DropError, ValueError):
    """An invalid value: outside its domain, or unreadable."""

    exit_code = 2


class RecordingError(DropError):
    """A recording that is missing, damaged, unfinished, or not made by `drop`."""


class OutputError(DropError):
    """A file that cannot be written under the name given."""


def check_suffix(option: str, path: Path, suffixes: Iterable[str]) -> None:
    """Check that a file's suffix names a format that can be written.

    Raises
    ------
    ScenarioError
        If the suffix is not among the given ones.
    """
    *others, last = suffixes
    if path.suffix in (*others, last):
        return
    allowed = Message("{one} or {other}", one=", ".join(others), other=last) if others else last
    raise ScenarioError(
        "{option} must end in {allowed}, got {path!r}",
        option=option,
        allowed=allowed,
        path=str(path),
    )

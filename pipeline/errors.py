"""The errors `drop` raises on purpose: one line each, with the rule, the value and what to try."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


class DropError(Exception):
    """Something could not be done; the message says what, and what to do."""

    exit_code = 1


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
        raise ScenarioError(f"{option} must end in {allowed}, got {str(path)!r}")

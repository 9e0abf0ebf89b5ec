"""Checks a script's path, arguments and limits before the script runs."""

from __future__ import annotations

import errno
import hashlib
import operator
import os
from collections.abc import Sequence
from numbers import Real
from pathlib import Path

from drop_physics.errors import ScenarioError
from drop_physics.fields import outside, shown
from drop_physics.messages import Message, shell_command

STOPPED = ("steps", "duration", "disk", "interrupted")
"""Ways in which a script ended because it was stopped, and would have continued."""
RERUN = b"RRF"
"""The first bytes of a recording file."""
LARGEST_INT = 2**63 - 1
"""The largest integer that a recording can hold."""
SEEDED_CLOCK_S = 1e9
"""Start time of the clock of a seeded script [s]: a morning in September 2001."""


def checked_limits(
    steps: int | None, duration_s: float | None, seed: int | None
) -> tuple[int | None, float | None, int | None]:
    """Check a recording's limits and seed, and return them as plain Python numbers.

    Raises
    ------
    ScenarioError
        If a value has another type, or a limit is one that no script can reach.
    """
    steps, seed = _integer("--steps", steps), _integer("--seed", seed)
    if duration_s is not None:
        try:
            if not isinstance(duration_s, Real) or isinstance(duration_s, bool):
                raise TypeError
            duration_s = float(duration_s)
        except (TypeError, OverflowError):
            raise outside("--duration", Message("a number"), duration_s) from None
    if steps is not None and not 1 <= steps <= LARGEST_INT:
        raise outside("--steps", Message("at least 1 and below 2**63"), steps)
    if duration_s is not None and not 0 < duration_s < float("inf"):
        raise outside("--duration", Message("finite and above {low:g}", low=0), duration_s)
    if seed is not None and abs(seed) > LARGEST_INT:
        raise outside("--seed", Message("between -2**63 and 2**63"), seed)
    return steps, duration_s, seed


def _integer(option: str, value: object) -> int | None:
    """Convert an integer of any library's type to a Python int."""
    if value is None:
        return None
    try:
        if isinstance(value, bool):
            raise TypeError
        return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise outside(option, Message("a whole number"), value) from None


def digest_of_script(target: str, *, is_module: bool) -> str | None:
    """Return the digest of a script's text; None for a module, whose file is unknown here."""
    if not isinstance(target, str | os.PathLike):
        raise ScenarioError(
            "the script must be the name of a file, got {value}; its arguments are a list of their "
            'own: record_script("sim.py", ["--fast"], out="sim.rrd")',
            value=shown(target),
        )
    if is_module:
        return None
    try:
        if Path(target).is_fifo():  # what is read here would be missing in the script
            raise OSError(errno.EINVAL, "a pipe can be read only once")
        text = Path(target).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: the name has a null character
        raise ScenarioError(
            "the script must be a Python file, got {path!r}: {reason}; a module is run with -m",
            path=target,
            reason=getattr(error, "strerror", None) or str(error),
        ) from None
    if text.startswith(RERUN):
        raise ScenarioError(
            "{path} is a recording; what happened in it says: {command}",
            path=target,
            command=shell_command("drop", "analyze", Path(target)),
        )
    if Path(target).suffix == ".ipynb":
        raise ScenarioError(
            "{path} is a notebook; record its cells in it, with: from drop_physics import record, "
            "and: {block}",
            path=target,
            block=f'with record("{Path(target).stem}.rrd"): …',
        )
    return hashlib.sha256(text).hexdigest()


def command_of(
    verb: str, target: str | Path, arguments: Sequence[str] = (), **options: float | str | None
) -> str:
    """Return the command line that runs a script with one of drop's commands.

    Parameters
    ----------
    verb
        The command of `drop`.
    target
        The script's path; `-m NAME` for a module.
    arguments
        The script's own arguments.
    options
        Options of the command, by name with underscores; None for options that are not given.
    """
    given = (
        word
        for name, value in options.items()
        if value is not None
        for word in (f"--{name}", value if isinstance(value, str) else _digits(value))
    )
    is_module = isinstance(target, str) and target.startswith("-m ")
    program = target.split(" ", 1) if isinstance(target, str) and is_module else [target]
    ends = ["--"] if not is_module and str(target).startswith("-") else []
    return shell_command("drop", verb, *given, *ends, *program, *arguments)


def _digits(value: float) -> str:
    """Format a number in the shortest form that parses to the same value: 2, not 2.0."""
    short = f"{value:.9g}"
    return short if isinstance(value, float) and float(short) == value else str(value)


def texts_of(arguments: Sequence[str]) -> list[str]:
    """Return a script's arguments as strings that can be passed to a process."""
    try:
        if isinstance(arguments, str | bytes):
            raise TypeError
        texts = [*map(os.fsdecode, arguments)]
        if any("\0" in text for text in texts):
            raise ValueError
        for text in texts:
            os.fsencode(text)
    except (TypeError, ValueError):
        if isinstance(arguments, str | os.PathLike):
            raise ScenarioError(
                "arguments must be a list, the script's own, got {value}; name the recording with: "
                "out={value}",
                value=shown(os.fspath(arguments)),
            ) from None
        raise ScenarioError(
            "arguments must be a list of texts without null characters, got {value}",
            value=shown(arguments),
        ) from None
    return texts


def encodable(text: str) -> str:
    """Replace the bytes of a text that are not UTF-8 by U+FFFD."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")

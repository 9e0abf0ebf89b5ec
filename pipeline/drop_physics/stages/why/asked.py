"""Checks the arguments of `drop why`, and chooses where to write its recordings."""

from __future__ import annotations

from pathlib import Path

from drop_physics.fields import outside
from drop_physics.files.outputs import make_folder
from drop_physics.messages import Message
from drop_physics.stages import verbs
from drop_physics.stages.found import is_of, origin_of


def checked_bounds(asked: verbs.WhyArguments) -> None:
    """Check the numeric arguments.

    Raises
    ------
    ScenarioError
        If an argument is out of range.
    """
    if not 0 < asked.budget_s < float("inf"):
        raise outside("--budget", Message("finite and above {low:g}", low=0), asked.budget_s)
    if asked.jobs is not None and asked.jobs < 1:
        raise outside("--jobs", Message("at least {low}", low=1), asked.jobs)


def place_of(asked: verbs.WhyArguments) -> tuple[Path | None, bool]:
    """Return where to write the recording (None: the default), and whether to overwrite it.

    A recording of the same script may be overwritten.
    """
    if asked.out is None:
        return None, asked.force
    placed = Path(asked.out) / f"{Path(asked.target).stem}.rrd"
    make_folder(placed.parent)
    origin = origin_of(placed) if placed.is_file() else None
    is_its = origin is not None and is_of(origin, asked.target, is_module=asked.is_module)
    return placed, asked.force or is_its

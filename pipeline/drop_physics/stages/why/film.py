"""Writes the video of `drop why`: the unchanged run and the best trial, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.errors import DropError
from drop_physics.stages.render import film_beside

if TYPE_CHECKING:
    from drop_physics.recording.falling import Progress  # its module loads Rerun
    from drop_physics.stages.why import Why


def write_film(why: Why, film: Path, *, force: bool, progress: Progress) -> None:
    """Write a video of the unchanged run beside the trial that fixes most findings.

    Raises
    ------
    DropError
        If no trial was run.
    OutputError
        If the file cannot be written.
    """
    filmed = why.filmed()
    if filmed is None:
        raise DropError(
            "there is nothing to film beside {script}: no trial of it was recorded; name one with "
            "--try",
            script=why.script,
        )
    film_beside(
        why.recording,
        filmed[0],
        film,
        titles=(Path(why.script).name, filmed[1]),
        force=force,
        progress=progress,
    )

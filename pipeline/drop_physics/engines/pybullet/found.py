"""Finds the URDF file of a body to drop: a path, or a file of `pybullet_data`."""

from __future__ import annotations

import contextlib
from pathlib import Path

from drop_physics.engines.pybullet.engine import data_folder
from drop_physics.engines.pybullet.probe import digest_of, try_body
from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.scenario import Scenario


def find_body(body: str) -> Path:
    """Return the URDF file for a name: a path, or a file of `pybullet_data`.

    The default body is always taken from `pybullet_data`, so that a default drop is the same in
    every folder.

    Raises
    ------
    ScenarioError
        If there is no such file, or if Bullet cannot load the user's file.
    """
    return _found(body)[0]


def body_digest(body: str) -> str | None:
    """Return the SHA-256 of a body's files, to detect edits; None if it cannot be loaded."""
    with contextlib.suppress(ScenarioError):  # its runs report what is wrong with it
        return _found(body)[1]
    return None


def _found(body: str) -> tuple[Path, str]:
    """Return a body's file, and the digest of all files that it loads."""
    bundled, is_folder = data_folder().resolve(), False
    candidates = [Path(body), bundled / body]
    if body == Scenario().body:
        candidates.reverse()
    for candidate in candidates:
        with contextlib.suppress(OSError):  # such as a name that is too long
            if candidate.is_file():
                ours = bundled in candidate.resolve().parents
                return candidate, digest_of([candidate]) if ours else try_body(candidate)
            is_folder |= candidate.is_dir()
    why = Message(", which is a folder") if is_folder else Message(", which is in neither place")
    raise ScenarioError(
        "--body must be a URDF file, here or in pybullet_data, got {body!r}{why}; try "
        "cube_small.urdf or ./my_body.urdf",
        body=body[:200],
        why=why,
    )

"""PyBullet itself: the only file that imports it, where its files lie, and which version it is."""

from __future__ import annotations

import contextlib
import functools
import hashlib
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.engines.bullet.c_output import c_output_moved_aside
from pipeline.engines.bullet.probe import digest_of, try_body
from pipeline.errors import ScenarioError


def _import_pybullet() -> tuple[Any, str]:
    with c_output_moved_aside() as printed:
        import pybullet
    return pybullet, printed[0].partition("build time:")[2].strip()


p, BUILD_TIME = _import_pybullet()
"""`BUILD_TIME` is what the banner says; empty where somebody imported pybullet before us."""


def find_body(body: str) -> Path:
    """Return the URDF file that a name means: a path, or a file of `pybullet_data`.

    Raises
    ------
    ScenarioError
        If there is no such file in either place, or it is the user's own and Bullet cannot take it.
    """
    theirs, why = data_folder().resolve(), "which is in neither place"
    for candidate in (Path(body), theirs / body):
        with contextlib.suppress(OSError):  # such as a name that is too long
            if candidate.is_file():
                if theirs not in candidate.resolve().parents:
                    try_body(candidate)
                return candidate
            if candidate.is_dir():
                why = "which is a folder"
    raise ScenarioError(
        f"--body must be a URDF file, here or in pybullet_data, got {body[:200]!r}, {why}; "
        "try cube_small.urdf or ./my_body.urdf"
    )


def body_digest(body: str) -> str | None:
    """Return the SHA-256 of a body's files, so that an edit is noticed; None where it has none."""
    with contextlib.suppress(ScenarioError):  # its runs say what is wrong with it
        path = find_body(body)
        with contextlib.suppress(ScenarioError):  # of pybullet_data, where Bullet takes more
            return digest_of(path)
        return hashlib.sha256(path.read_bytes()).hexdigest()
    return None


@functools.cache
def data_folder() -> Path:
    """Return the folder of `pybullet_data`."""
    import pybullet_data

    return Path(pybullet_data.getDataPath())


@functools.cache
def engine_versions() -> dict[str, str]:
    """Return what decides the engine's numbers: its version, its wheel, and when it was built."""
    distribution = metadata.distribution("pybullet")
    wheel = (distribution.read_text("WHEEL") or "").partition("Tag:")[2].split()
    versions = {"pybullet_version": distribution.version, "pybullet_build": BUILD_TIME}
    return versions | {"pybullet_wheel": wheel[0] if wheel else ""}

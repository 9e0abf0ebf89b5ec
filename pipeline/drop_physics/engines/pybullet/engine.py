"""PyBullet, its data folder, and its version; the only module that imports PyBullet."""

from __future__ import annotations

import functools
from importlib import metadata
from pathlib import Path
from typing import Any

from drop_physics.engines.pybullet.c_output import c_output_moved_aside


def _import_pybullet() -> tuple[Any, str]:
    with c_output_moved_aside() as printed:
        import pybullet
    return pybullet, printed[0].partition("build time:")[2].strip()


p, BUILD_TIME = _import_pybullet()
"""PyBullet, and its build time from the banner; empty if pybullet was already imported."""


@functools.cache
def data_folder() -> Path:
    """Return the folder of `pybullet_data`."""
    import pybullet_data

    return Path(pybullet_data.getDataPath())


@functools.cache
def engine_versions() -> dict[str, str]:
    """Return the versions that PyBullet's results may depend on: version, wheel and build time."""
    distribution = metadata.distribution("pybullet")
    wheel = (distribution.read_text("WHEEL") or "").partition("Tag:")[2].split()
    versions = {"pybullet_version": distribution.version, "pybullet_build": BUILD_TIME}
    return versions | {"pybullet_wheel": wheel[0] if wheel else ""}

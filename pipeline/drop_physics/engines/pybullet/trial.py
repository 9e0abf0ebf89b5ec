"""Loads, drops and renders a body as a test, in a process that may crash."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sys
from pathlib import Path
from typing import get_args

from drop_physics.engines.pybullet import probe
from drop_physics.engines.pybullet.body_files import LARGEST, BodyFileError
from drop_physics.engines.pybullet.c_output import c_output_moved_aside
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.visible_world import VisibleWorld
from drop_physics.errors import DropError
from drop_physics.messages import Message
from drop_physics.scenario import STANDARD_CAMERA, Coordinates, Scenario
from drop_physics.workers import under_load

LONGEST_WORDS = 200
"""Number of characters quoted from the end of Bullet's messages."""
STEPS = 3
"""Number of steps from inside the floor: the first has contact, in which bad meshes fail."""


def trial(path: str, limits: probe.Limits) -> tuple[str, list[Path]]:
    """Load, drop and render a URDF in this process; return the problem, and its meshes.

    Errors that the drop itself will report are not included.
    """
    probe.trying = True
    _limit(limits)
    meshes: list[Path] = []
    try:
        meshes += _meshes_of(path)
        if problem := probe.first_problem(meshes):
            return problem, meshes
        with c_output_moved_aside():
            for coordinates in get_args(Coordinates):
                with contextlib.suppress(DropError):
                    _drop(path, coordinates)
    except BodyFileError as error:
        return error.problem, meshes
    except Exception as error:  # noqa: BLE001 - whatever it is, it is the body's
        kind, text = type(error).__name__, str(error)[:100]
        return Message("Bullet fails on it ({kind}: {error!r})", kind=kind, error=text), meshes
    return "", meshes


def _meshes_of(path: str) -> list[Path]:
    """Load a URDF, and return the mesh files that Bullet found."""
    client = p.connect(p.DIRECT)
    body = None
    with c_output_moved_aside() as printed, contextlib.suppress(p.error):
        body = p.loadURDF(path, physicsClientId=client)
    said = [line.strip() for line in _BULLETS.sub("\n", printed[0]).splitlines() if line.strip()]
    if body is None or any("Couldn't parse" in line for line in said):
        # It ends with what it fails on; before that it may have warned of other things.
        words = ", ".join(dict.fromkeys(said))[-LONGEST_WORDS:]
        raise BodyFileError(Message("Bullet cannot load it (… {words!r})", words=words))
    links = range(-1, p.getNumJoints(body, client))
    shapes = [one for link in links for one in p.getCollisionShapeData(body, link, client)]
    names = [one[4] for one in (*shapes, *p.getVisualShapeData(body, physicsClientId=client))]
    p.disconnect(client)
    return [Path(os.fsdecode(name)) for name in dict.fromkeys(filter(None, names))]


_BULLETS = re.compile(r"b3\w+\[[^]]*\]:")
"""Pattern of source locations that Bullet prints in messages."""


def _drop(path: str, coordinates: Coordinates) -> None:
    scenario = Scenario(
        body=path, coordinates=coordinates, height_m=0.05, duration_s=STEPS * Scenario().timestep_s
    )
    with VisibleWorld(scenario, "tiny") as world:
        world.report()
        if not max(abs(world.half_size_m)) <= LARGEST:
            raise BodyFileError(
                Message("its size must be finite and at most {largest:g} m", largest=LARGEST)
            )
        for _ in world.samples(STEPS):
            pass
        world.photograph(STANDARD_CAMERA)


def _limit(limits: probe.Limits) -> None:
    """Let the system end this process, without a core dump, if it exceeds a limit."""
    if sys.platform == "win32":
        return
    import resource

    signal.alarm(round(under_load(limits.wall_s)))
    for kind, most in (
        (resource.RLIMIT_CPU, limits.cpu_s),
        (resource.RLIMIT_AS, limits.memory_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
        with contextlib.suppress(ValueError, OSError):  # macOS has no RLIMIT_AS
            resource.setrlimit(kind, (allowed, hard))

"""Try a body in a process of its own: what ends Bullet ends that process, and is one line here.

A URDF of `pybullet_data` is taken as it is. Any other one, with its meshes and textures, is loaded,
dropped and photographed once, under limits of time and memory, before this process touches it.
"""

from __future__ import annotations

import contextlib
import hashlib
import signal
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from pipeline.engines.bullet.body_files import BodyFileError, check_content, read
from pipeline.engines.bullet.c_output import c_output_moved_aside
from pipeline.engines.bullet.urdf import LARGEST, cannot_load, check_urdf
from pipeline.errors import DropError
from pipeline.scenario import STANDARD_CAMERA, Coordinates, Scenario
from pipeline.workers import Worker, WorkerDiedError


@dataclass(frozen=True)
class Limits:
    """What a trial may take."""

    cpu_s: int = 20
    """Of computing: another process beside it takes none of that."""
    wall_s: int = 120
    """Of waiting."""
    memory_bytes: int = 4_000_000_000
    """Of address space."""


STANDARD_LIMITS = Limits()
STEPS = 3
"""From within the floor: the first one is contact, which is what meshes fail at."""

_TOO_LONG = [getattr(signal, name, None) for name in ("SIGALRM", "SIGXCPU")]
_verdicts: dict[str, str] = {}
"""What is wrong with bodies that were tried, by the digest of all their files; nothing is ''."""
_trying = False
"""Whether this process is the trial."""


def try_body(path: Path) -> None:
    """Make sure that a URDF that is not PyBullet's own can be loaded and dropped.

    The same files are tried once in a process.

    Raises
    ------
    ScenarioError
        If it cannot be given to Bullet, or Bullet dies of it, hangs, or takes too much memory.
    """
    if _trying:
        return
    digest = digest_of(path)
    if digest not in _verdicts:
        _verdicts[digest] = problem_of(path)
    if _verdicts[digest]:
        raise cannot_load(path, _verdicts[digest])


def verdicts() -> Mapping[str, str]:
    """Return what is known of bodies, for another process to `believe`."""
    return dict(_verdicts)


def believe(known: Mapping[str, str]) -> None:
    """Take over what another process of ours found out.

    Of files, not of names: a body that has changed since has another digest, and is tried.
    """
    _verdicts.update(known)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a URDF and of all files that it names.

    Raises
    ------
    ScenarioError
        If one of them cannot be given to Bullet.
    """
    digest = hashlib.sha256()
    try:
        for file in check_urdf(path):
            digest.update(hashlib.sha256(read(file)).digest())
    except BodyFileError as error:
        raise cannot_load(path, str(error)) from None
    return digest.hexdigest()


def problem_of(path: Path, limits: Limits = STANDARD_LIMITS) -> str:
    """Return what a trial says of a URDF, or nothing."""
    with Worker() as worker:
        try:
            worker.ask(f"{__name__}:trial", str(path), limits)
            return str(worker.answer())
        except WorkerDiedError as error:
            if error.signal in _TOO_LONG:
                return f"Bullet is not done with it after {limits.cpu_s} s; give it smaller meshes"
            return (
                f"Bullet crashes with it, or takes more than {limits.memory_bytes / 1e9:g} GB "
                f"({error.how}); look at its meshes"
            )


def trial(path: str, limits: Limits) -> str:
    """Load, drop and photograph a URDF in this process, and return what is wrong with it.

    Of what a drop itself would say in one line nothing is said.
    """
    global _trying
    _trying = True
    _limit(limits)
    with c_output_moved_aside():
        try:
            for file in check_urdf(Path(path)):
                check_content(file)
            for coordinates in get_args(Coordinates):
                with contextlib.suppress(DropError):
                    _drop(path, coordinates)
        except BodyFileError as error:
            return str(error)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is the body's
            return f"Bullet cannot cope with it ({type(error).__name__}: {str(error)[:100]!r})"
    return ""


def _drop(path: str, coordinates: Coordinates) -> None:
    from pipeline.engines.bullet.visible_world import VisibleWorld

    scenario = Scenario(
        body=path, coordinates=coordinates, height_m=0.05, duration_s=STEPS * Scenario().timestep_s
    )
    with VisibleWorld(scenario, "tiny") as world:
        world.report()
        if not max(abs(world.half_size_m)) <= LARGEST:
            raise BodyFileError("to Bullet it has no size")
        for _ in world.samples(STEPS):
            pass
        world.photograph(STANDARD_CAMERA)


def _limit(limits: Limits) -> None:
    """Let the system end this process where it takes too much, or leave a picture of its memory."""
    if sys.platform == "win32":
        return
    import resource

    signal.alarm(limits.wall_s)
    for kind, most in (
        (resource.RLIMIT_CPU, limits.cpu_s),
        (resource.RLIMIT_AS, limits.memory_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
        with contextlib.suppress(ValueError, OSError):  # macOS takes no RLIMIT_AS
            resource.setrlimit(kind, (allowed, hard))

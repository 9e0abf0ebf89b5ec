"""Try a body in a separate process: a crash of Bullet ends that process, and is an error here.

A URDF of `pybullet_data` is trusted. Any other, with its meshes and textures, is loaded, dropped
and photographed once, under limits of time and memory, before this process touches it.
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

from drop_physics.engines.bullet.body_files import BodyFileError, check_content, read
from drop_physics.engines.bullet.c_output import c_output_moved_aside
from drop_physics.engines.bullet.urdf import LARGEST, cannot_load, check_urdf
from drop_physics.errors import DropError
from drop_physics.messages import Message
from drop_physics.scenario import STANDARD_CAMERA, Coordinates, Scenario
from drop_physics.workers import Worker, WorkerDiedError


@dataclass(frozen=True)
class Limits:
    """What a trial may take."""

    cpu_s: int = 20
    """CPU time: other processes do not use it up."""
    wall_s: int = 120
    """Elapsed time."""
    memory_bytes: int = 4_000_000_000
    """Address space."""


STANDARD_LIMITS = Limits()
STEPS = 3
"""From inside the floor: already the first step has contact, where meshes fail."""

_TOO_LONG = [getattr(signal, name, None) for name in ("SIGALRM", "SIGXCPU")]
_verdicts: dict[str, str] = {}
"""What is wrong with each body tried, by the digest of all its files; '' if nothing."""
_trying = False
"""Whether this process is the trial."""


def try_body(path: Path) -> None:
    """Make sure that a URDF other than PyBullet's own can be loaded and dropped.

    The same files are tried once per process.

    Raises
    ------
    ScenarioError
        If it is not safe to load, or Bullet crashes, hangs or takes too much memory.
    """
    if _trying:
        return
    digest = digest_of(path)
    if digest not in _verdicts:
        _verdicts[digest] = problem_of(path)
    if _verdicts[digest]:
        raise cannot_load(path, _verdicts[digest])


def verdicts() -> Mapping[str, str]:
    """Return the verdicts so far, for another process to `believe`."""
    return dict(_verdicts)


def believe(known: Mapping[str, str]) -> None:
    """Adopt the verdicts of another of our processes.

    They belong to contents, not names: a body edited since has another digest, and is tried.
    """
    _verdicts.update(known)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a URDF and of all files that it names.

    Raises
    ------
    ScenarioError
        If one of them is not safe to load.
    """
    digest = hashlib.sha256()
    try:
        for file in check_urdf(path):
            digest.update(hashlib.sha256(read(file)).digest())
    except BodyFileError as error:
        raise cannot_load(path, error.problem) from None
    return digest.hexdigest()


def problem_of(path: Path, limits: Limits = STANDARD_LIMITS) -> str:
    """Return what a trial finds wrong with a URDF, or ''."""
    with Worker() as worker:
        try:
            worker.ask(f"{__name__}:trial", str(path), limits)
            problem: str = worker.answer()
        except WorkerDiedError as error:
            if error.signal in _TOO_LONG:
                return Message(
                    "Bullet has not finished with it after {seconds} s; use smaller meshes",
                    seconds=limits.cpu_s,
                )
            return Message(
                "Bullet crashes on it, or takes more than {memory:g} GB ({how}); check its meshes",
                memory=limits.memory_bytes / 1e9,
                how=error.how,
            )
        return problem


def trial(path: str, limits: Limits) -> str:
    """Load, drop and photograph a URDF in this process, and return what is wrong with it, or ''.

    What a drop itself reports as an error is left to it.
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
            return error.problem
        except Exception as error:  # noqa: BLE001 - whatever it is, it is the body's
            return Message(
                "Bullet fails on it ({kind}: {error!r})",
                kind=type(error).__name__,
                error=str(error)[:100],
            )
    return ""


def _drop(path: str, coordinates: Coordinates) -> None:
    from drop_physics.engines.bullet.visible_world import VisibleWorld

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


def _limit(limits: Limits) -> None:
    """Let the system end this process, without a core dump, if it takes too much."""
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
        with contextlib.suppress(ValueError, OSError):  # macOS has no RLIMIT_AS
            resource.setrlimit(kind, (allowed, hard))

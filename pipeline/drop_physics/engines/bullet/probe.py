"""Try a body in a separate process: a crash of Bullet ends that process, and is an error here.

A URDF of `pybullet_data` is trusted. Any other is loaded, dropped and photographed once, under
limits of time and memory, before this process touches it; its meshes are those that Bullet names.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from drop_physics.engines.bullet.body_files import LARGEST, BodyFileError, check_mesh, check_urdf
from drop_physics.engines.bullet.c_output import c_output_moved_aside
from drop_physics.errors import DropError, ScenarioError
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


@dataclass(frozen=True)
class Verdict:
    """What a trial found."""

    problem: str
    """What is wrong with the body, or ''."""
    files: tuple[Path, ...]
    """The URDF and its meshes."""
    digest: str
    """Of these files, as they were tried."""


Verdicts = Mapping[Path, Verdict]
"""By the resolved path of a URDF."""

STANDARD_LIMITS = Limits()
LONGEST_WORDS = 200
"""Characters of what Bullet says that are quoted: the last ones."""
STEPS = 3
"""From inside the floor: already the first step has contact, where meshes fail."""

_TOO_LONG = [getattr(signal, name, None) for name in ("SIGALRM", "SIGXCPU")]
_verdicts: dict[Path, Verdict] = {}
_trying = False
"""Whether this process is the trial."""


def try_body(path: Path) -> str:
    """Make sure that a URDF other than PyBullet's own can be loaded and dropped.

    The same files are tried once per process.

    Returns
    -------
    The digest of the URDF and its meshes.

    Raises
    ------
    ScenarioError
        If it is not safe to load, or Bullet fails on it, crashes, hangs or takes too much memory.
    """
    if _trying:
        return ""
    name = path.resolve()
    verdict = _verdicts.get(name)
    if verdict is None or digest_of(verdict.files) != verdict.digest:
        problem, meshes = problem_of(path)
        files = (name, *map(Path.resolve, meshes))
        verdict = _verdicts[name] = Verdict(problem, files, digest_of(files))
    if verdict.problem:
        raise ScenarioError(
            "--body must be a URDF that Bullet can load, got {path!r}: {problem}",
            path=str(path)[:200],
            problem=verdict.problem,
        )
    return verdict.digest


def verdicts() -> Verdicts:
    """Return the verdicts so far, for another process to `believe`."""
    return dict(_verdicts)


def believe(known: Verdicts) -> None:
    """Adopt the verdicts of another of our processes: a body edited since is tried again."""
    _verdicts.update(known)


def digest_of(files: Sequence[Path]) -> str:
    """Return the SHA-256 of files; one that is gone counts as empty."""
    digest = hashlib.sha256()
    for file in files:
        content = file.read_bytes() if file.is_file() else b""
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()


def problem_of(path: Path, limits: Limits = STANDARD_LIMITS) -> tuple[str, list[Path]]:
    """Return what is wrong with a URDF, or '', and its meshes."""
    try:
        check_urdf(path)
    except BodyFileError as error:
        return error.problem, []
    with Worker() as worker:
        try:
            worker.ask(f"{__name__}:trial", str(path), limits)
            found: tuple[str, list[Path]] = worker.answer()
        except WorkerDiedError as error:
            if error.signal in _TOO_LONG:
                problem = Message(
                    "Bullet has not finished with it after {seconds} s; use smaller meshes",
                    seconds=limits.cpu_s,
                )
            else:
                problem = Message(
                    "Bullet crashes on it, or takes more than {memory:g} GB ({how}); check its "
                    "links and meshes",
                    memory=limits.memory_bytes / 1e9,
                    how=error.how,
                )
            beside = _named_beside(path)
            return _first_problem(beside) or problem, beside
        return found


def _named_beside(path: Path) -> list[Path]:
    """Return the files that a URDF names and that are beside it: one of them may be mended."""
    names = re.findall(rb"""filename\s*=\s*["']([^"']+)""", path.read_bytes())
    beside = (path.parent / name.decode(errors="replace") for name in names)
    return [file for file in beside if file.is_file()]


def _first_problem(meshes: Sequence[Path]) -> str:
    try:
        for mesh in meshes:
            check_mesh(mesh)
    except BodyFileError as error:
        return error.problem
    return ""


def trial(path: str, limits: Limits) -> tuple[str, list[Path]]:
    """Load, drop and photograph a URDF in this process: return what is wrong, and its meshes.

    What a drop itself reports as an error is left to it.
    """
    global _trying
    _trying = True
    _limit(limits)
    meshes: list[Path] = []
    try:
        meshes += _meshes_of(path)
        if problem := _first_problem(meshes):
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
    """Load a URDF, and return its meshes, where Bullet has found them."""
    from drop_physics.engines.bullet.engine import p

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
"""Where in its own source Bullet prints."""


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

"""Tests in a separate process, which may crash, whether Bullet can load and drop a body.

A URDF of `pybullet_data` is trusted. Any other is loaded, dropped and rendered once, under limits
of time and memory, before this process loads it. The names of its mesh files come from Bullet.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from drop_physics.engines.pybullet.body_files import BodyFileError, check_mesh, check_urdf
from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.workers import ALARM, CPU_USED_UP, Worker, WorkerDiedError


@dataclass(frozen=True)
class Limits:
    """Time, memory and other limits of a body's test."""

    cpu_s: int = 20
    """CPU time [s], which the load of the machine hardly affects."""
    wall_s: int = 120
    """Elapsed time [s], on an idle machine."""
    memory_bytes: int = 4_000_000_000
    """Address space [bytes]."""


@dataclass(frozen=True)
class Verdict:
    """The result of a body's test: the problem, if any."""

    problem: str
    """The problem with the body, or ''."""
    files: tuple[Path, ...]
    """The URDF and its meshes."""
    digest: str
    """The digest of these files when they were tested."""


Verdicts = Mapping[Path, Verdict]
"""Test results of URDFs, by their resolved paths."""

STANDARD_LIMITS = Limits()
TRIAL = "drop_physics.engines.pybullet.trial:trial"
"""The test function, by name, since only the separate process may import its module."""

_verdicts: dict[Path, Verdict] = {}
trying = False
"""Whether this process is the test process."""


def try_body(path: Path) -> str:
    """Check that a URDF other than PyBullet's own can be loaded and dropped.

    The same files are tested only once per process.

    Returns
    -------
    The digest of the URDF and its meshes.

    Raises
    ------
    ScenarioError
        If the URDF is not safe to load, or Bullet fails, crashes, hangs or takes too much memory.
    """
    if trying:
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
    """Return the test results so far, to pass to another process's `believe`."""
    return dict(_verdicts)


def believe(known: Verdicts) -> None:
    """Adopt another process's test results; a body that was edited later is tested again."""
    _verdicts.update(known)


def digest_of(files: Sequence[Path]) -> str:
    """Return the SHA-256 of files; a missing file counts as empty."""
    digest = hashlib.sha256()
    for file in files:
        content = file.read_bytes() if file.is_file() else b""
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()


def problem_of(path: Path, limits: Limits = STANDARD_LIMITS) -> tuple[str, list[Path]]:
    """Return the problem with a URDF, or '', and its meshes."""
    try:
        check_urdf(path)
    except BodyFileError as error:
        return error.problem, []
    with Worker() as worker:
        try:
            worker.ask(TRIAL, str(path), limits)
            found: tuple[str, list[Path]] = worker.answer()
        except WorkerDiedError as error:
            if error.signal == CPU_USED_UP:
                problem = Message(
                    "Bullet has not finished with it after {seconds} s of computing; use smaller "
                    "meshes",
                    seconds=limits.cpu_s,
                )
            elif error.signal == ALARM:
                problem = Message(
                    "Bullet has not finished with it after {wall} s, and computed for less than "
                    "{cpu} s: it waits for something that it reads, or for other programs",
                    wall=limits.wall_s,
                    cpu=limits.cpu_s,
                )
            else:
                problem = Message(
                    "Bullet crashes on it, or takes more than {memory:g} GB ({how}); check its "
                    "links and meshes",
                    memory=limits.memory_bytes / 1e9,
                    how=error.how,
                )
            beside = _named_beside(path)
            return first_problem(beside) or problem, beside
        return found


def _named_beside(path: Path) -> list[Path]:
    """Return the files in a URDF's folder that the URDF names, even missing ones."""
    names = re.findall(rb"""filename\s*=\s*["']([^"']+)""", path.read_bytes())
    beside = (path.parent / name.decode(errors="replace") for name in names)
    return [file for file in beside if file.is_file()]


def first_problem(meshes: Sequence[Path]) -> str:
    """Return the problem with the first mesh that Bullet would misread, or ''."""
    try:
        for mesh in meshes:
            check_mesh(mesh)
    except BodyFileError as error:
        return error.problem
    return ""

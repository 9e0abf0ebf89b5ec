"""Records a few lines of PyBullet in a tenth of a second, within this process.

The same watching half, the same recorder, the same file; only that one process has both, a worker
that records one scene after the other, and that Rerun's own programs are left out.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import multiprocessing
import os
import shutil
import sys
import tempfile
import textwrap
import uuid
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import IO, Any
from unittest.mock import patch

import pybullet as p
from command import HANGS_S
from drop_physics.analysis.results import Analysis, BodyAnalysis
from drop_physics.analysis.story import Story
from drop_physics.engines.cures import call_of
from drop_physics.engines.script import BlockListener
from drop_physics.engines.watching import ending, pipe, start
from drop_physics.explain.recording import Explanation
from drop_physics.recording import schema, writer
from drop_physics.recording.about import about_script
from drop_physics.recording.layout import layout
from drop_physics.recording.reader import Recording, read
from drop_physics.recording.recorder import Recorder
from drop_physics.rules.answer import Finding
from drop_physics.trace.cures import ChangedRun
from drop_physics.trace.history import Seen

HEAD = """\
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
def steps(number):
    for _ in range(number):
        p.stepSimulation()
"""
"""Code before every scene; the scene's own line numbers start after it."""
NAME = "scene.py"
Code = tuple[tuple[str, str], ...]
"""Source texts, each with its file name."""
ORIGIN = {"kind": "script", "script": NAME}
MOST_CLIENTS = 4


def site(line: int) -> str:
    """Return the call site of a scene's line as findings cite it; the first line is 1."""
    return f"{NAME}:{line}"


def record(scene: str, path: Path, *, for_viewer: bool = False, folder: Path = Path()) -> Recording:
    """Record a scene, and read its recording back.

    Parameters
    ----------
    scene
        Its lines, behind `HEAD`: a client is connected, nothing is loaded, gravity is not set.
    path
        The recording to write.
    for_viewer
        Whether it has a layout, as users' recordings do. Without one the viewer makes its own, and
        keeps that if the layer's arrives first.
    folder
        Where it runs.
    """
    code = _code(scene)
    kept = _kept() / hashlib.sha256(repr((code, for_viewer)).encode()).hexdigest()
    if folder == Path() and kept.exists():  # the same scene of another test
        shutil.copyfile(kept, path)
        return read(path)
    _worker().submit(_record, code, path, for_viewer, folder).result(timeout=HANGS_S)
    if folder == Path():
        shutil.copyfile(path, kept)
    return read(path)


def number_of(scene: str, name: str, folder: Path, changed: ChangedRun | None = None) -> float:
    """Run a scene in a folder with changes applied, and return the value of a variable."""
    run = changed or ChangedRun([])
    made = _worker().submit(_number_of, _code(scene), name, folder, run.operations, run.finer)
    return float(made.result(timeout=HANGS_S))


def _code(scene: str) -> Code:
    return (HEAD, NAME), (textwrap.dedent(scene).lstrip("\n"), NAME)


def record_file(script: Path, path: Path, *arguments: str) -> Recording:
    """Record a script in its folder, named in findings by file name only, and read the recording.

    It has a layout.
    """
    code = ((script.read_text(), script.name),)
    _worker().submit(_record, code, path, True, script.parent, arguments).result(timeout=HANGS_S)
    return read(path)


@functools.cache
def _kept() -> Path:
    """Return the folder of this process's recordings."""
    folder = tempfile.TemporaryDirectory(prefix="scenes-")
    atexit.register(folder.cleanup)
    return Path(folder.name)


@functools.cache
def _worker() -> ProcessPoolExecutor:
    """Return the worker process, in which client 0 is free; here earlier tests may have used it."""
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))


def _record(
    code: Code, path: Path, for_viewer: bool, folder: Path = Path(), arguments: Sequence[str] = ()
) -> None:
    text, name = code[-1]
    digest = hashlib.sha256(text.encode()).hexdigest()
    origin = ORIGIN | {"script": name, "arguments": [*arguments], "script_sha256": digest}
    with patch.object(sys, "argv", [name, *arguments]), _watched(code, folder) as (files, _):
        stream, memory = files
        stream.seek(0)  # a file in place of a pipe: nobody has to read it meanwhile
        recorder = Recorder({schema.ORIGIN_PROPERTY: origin})
        listener = BlockListener(stream.fileno(), memory.fileno(), process=os.getppid())
        writer.record(
            path,
            recorder.chunks(
                listener.events(),
                listener.ending,
                lambda ended: about_script(origin, recorder, ended),
            ),
            recording_id=uuid.uuid4().hex,
            force=True,
            blueprint=(lambda: layout(recorder.look())) if for_viewer else None,
        )


@contextlib.contextmanager
def _watched(
    code: Code, folder: Path, **how: Any
) -> Iterator[tuple[tuple[IO[bytes], IO[bytes]], dict[str, Any]]]:
    """Run a scene; yield the sent data, the shared memory, and the scene's variables."""
    _as_at_first()
    with (
        contextlib.chdir(folder),
        tempfile.TemporaryFile() as memory,
        tempfile.TemporaryFile() as stream,
    ):
        memory.truncate(pipe.SHARED_BYTES)
        limits: dict[str, Any] = {"steps": None, "duration_s": None}
        watch = start.watch(
            os.dup(stream.fileno()),
            os.dup(memory.fileno()),
            **limits,
            keep_sleeping=False,
            seed=None,
            **how,
        )
        try:
            names = _run(code)
        finally:
            ending.end(watch, "finished")
            watch.remove()
            watch.pipe.close()
            for client in filter(p.isConnected, range(MOST_CLIENTS)):
                p.disconnect(client)
        yield (stream, memory), names


def _number_of(
    code: Code, name: str, folder: Path, operations: Sequence[dict[str, Any]], finer: int
) -> Any:
    variation = {"finer": finer} if finer > 1 else None
    with _watched(code, folder, interventions=operations, variation=variation) as (_, names):
        return names[name]


def _as_at_first() -> None:
    """Restore the settings that PyBullet keeps for the whole process."""
    client = p.connect(p.DIRECT)
    p.setPhysicsEngineParameter(contactBreakingThreshold=0.02, physicsClientId=client)
    p.disconnect(client)


def _run(code: Code) -> dict[str, Any]:
    names: dict[str, Any] = {"__name__": "__main__"}
    for text, name in code:
        exec(compile(text, name, "exec"), names)
    return names


def analyze(seen: Seen, **how: Any) -> Analysis:
    """Return the analysis of a recording."""
    return Story(seen, {}, **{"call_of": call_of(seen.engine), **how}).analysis()


def body_of(analysis: Analysis, number: int) -> BodyAnalysis:
    """Return the analysis of one body."""
    return next(one for one in analysis.bodies if one.id == number)


def codes(analysis: Analysis) -> list[str]:
    """Return the codes of all findings, in order."""
    return [one.code for one in analysis.findings]


def found(analysis: Analysis, code: str) -> Finding:
    """Return the only finding of a code."""
    (one,) = (one for one in analysis.findings if one.code == code)
    return one


def explanation(seen: Seen) -> Explanation:
    """Return the explanation of a whole recording, after going through all of its chunks."""
    whole = Explanation(seen)
    for _ in whole.pieces():
        pass
    return whole

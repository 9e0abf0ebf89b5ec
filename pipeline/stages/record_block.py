"""Record what a block of Python does with PyBullet: in notebooks, and in tests.

    with record("run.rrd"):
        ...

The recording is made by a process of its own, so that it is whole even where this one crashes.
Functions that were taken from pybullet by name before the block (`from pybullet import
stepSimulation`) are not seen; nothing is patched outside of it.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.engines.bullet.script import Listener, shared_block
from pipeline.engines.bullet.watching import ending, start
from pipeline.engines.bullet.watching.hooks import Stop
from pipeline.errors import DropError, OutputError, check_suffix
from pipeline.files.outputs import check_target
from pipeline.recording import writer
from pipeline.recording.script import Script
from pipeline.recording.script_layout import layout
from pipeline.stages.record import Recorded, checked_limits, recorded_of
from pipeline.workers import module_path

BLOCK = "a block of Python"
"""What is said of it where a script has its name."""


class Block:
    """A block that is recorded; `recorded` says what of, once it has ended."""

    recorded: Recorded | None = None


@contextmanager
def record(
    out: Path | str,
    *,
    steps: int | None = None,
    duration_s: float | None = None,
    seed: int | None = None,
    keep_sleeping: bool = False,
    force: bool = False,
) -> Iterator[Block]:
    """Record what is done with PyBullet in a `with` block, as `drop record` does of a script.

    Parameters
    ----------
    out
        The recording to write.
    steps, duration_s
        After how many steps, and how much simulated time [s], the block is left; without either,
        after a minute.
    seed
        Of `random`, `numpy.random`, and what numpy's `SeedSequence` draws; None leaves them alone.
    keep_sleeping
        Whether the block sleeps when it asks to.
    force
        Whether an existing recording may be replaced.

    Raises
    ------
    ScenarioError
        If a limit is none.
    OutputError
        If the recording cannot be written.
    """
    path, block = Path(out), Block()
    check_target(path, force=force)
    check_suffix("out", path, (".rrd",))
    steps, duration_s, seed = checked_limits(steps, duration_s, seed)
    with shared_block() as memory:
        reading, writing = os.pipe()
        told = {"reading": reading, "block": memory.fileno(), "out": str(path), "force": force}
        with subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, json.dumps(told)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            pass_fds=(reading, memory.fileno()),
            env={**os.environ, "PYTHONPATH": os.pathsep.join(module_path())},
        ) as recorder:
            os.close(reading)
            watch = start.watch(
                writing, os.dup(memory.fileno()), steps=steps, duration_s=duration_s,
                keep_sleeping=keep_sleeping, seed=seed,
            )  # fmt: skip
            how, error = "finished", ""
            try:
                yield block
            except Stop:
                how = "stopped"
            except BaseException as failure:
                how, error = "failed", ending.in_one_line(failure)
                raise
            finally:
                ending.end(watch, how, error)
                watch.remove()
                watch.pipe.close()
                assert recorder.stdout is not None
                answer = recorder.stdout.read()
    if not answer:
        raise OutputError(f"{path} was not written: the process that records it ended")
    said: dict[str, Any] = json.loads(answer)
    if "error" in said and "recording" not in said:
        raise OutputError(said["error"])
    block.recorded = replace(Recorded(**said), recording=path)


def _record(told: dict[str, Any]) -> dict[str, Any]:
    """Record what comes down a pipe, and return what there is to say of it."""
    began = time.perf_counter()
    path, recording_id = Path(told["out"]), uuid.uuid4().hex
    script = Script(
        {
            "kind": "script",
            "script": BLOCK,
            "drop_version": metadata.version("drop-physics"),
        }
    )
    listener = Listener(told["reading"], told["block"])
    writer.record(
        path,
        script.chunks(listener.events(), listener.ending),
        recording_id=recording_id,
        blueprint=lambda: layout(script),
        force=told["force"],
    )
    recorded = recorded_of(script, listener.ending(), path, recording_id=recording_id, name=BLOCK)
    wall_s = time.perf_counter() - began
    return asdict(recorded) | {"recording": str(path), "wall_s": wall_s}


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is the block's, which ends and is recorded
    try:
        answered = _record(json.loads(sys.argv[1]))
    except DropError as failure:
        answered = {"error": "; ".join([failure.in_options, *getattr(failure, "__notes__", [])])}
    print(json.dumps(answered))

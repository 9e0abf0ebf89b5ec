"""Record what a block of Python does with PyBullet, in notebooks and tests.

    with record("run.rrd"):
        ...

A separate process writes the recording, so that it is complete even if this one crashes. Functions
imported from pybullet by name before the block (`from pybullet import stepSimulation`) are not
seen; nothing is patched outside the block.
"""

from __future__ import annotations

import contextlib
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

from drop_physics.engines.pybullet.script import BlockListener, shared_block
from drop_physics.engines.pybullet.watch import ending, start
from drop_physics.engines.pybullet.watch.hooks import Stop, Watch
from drop_physics.errors import NO_MEMORY, DropError, OutputError, check_suffix
from drop_physics.files.outputs import check_target
from drop_physics.recording import schema
from drop_physics.recording.recorder import Recorder
from drop_physics.stages.program import checked_limits
from drop_physics.stages.record import Recorded, recorded_of, written
from drop_physics.workers import our_environment


class Block:
    """A block that is being recorded; `recorded` is the result, once it has ended."""

    recorded: Recorded | None = None
    watch: Watch

    @property
    def steps(self) -> int:
        """Steps made so far."""
        return self.watch.steps_made


@contextmanager
def record(
    out: Path | str,
    *,
    steps: int | None = None,
    duration_s: float | None = None,
    seed: int | None = None,
    keep_sleeping: bool = False,
    drawn: bool = True,
    force: bool = False,
) -> Iterator[Block]:
    """Record what a `with` block does with PyBullet, as `drop record` does for a script.

    Parameters
    ----------
    out
        The recording to write.
    steps, duration_s
        Number of steps, and simulated time [s], after which the block is left; None for never.
    seed
        The seed of `random`, `numpy.random`, and numpy's `SeedSequence`; None leaves them alone.
    keep_sleeping
        Whether the block's sleeps take time.
    drawn
        Whether it also holds what is only for looking: shapes, poses, curves.
    force
        Whether an existing recording may be replaced.

    Raises
    ------
    ScenarioError
        If a limit is not above 0.
    OutputError
        If the recording cannot be written.
    """
    path, block = Path(out), Block()
    check_target(path, force=force)
    check_suffix("out", path, (".rrd",))
    steps, duration_s, seed = checked_limits(steps, duration_s, seed)
    with shared_block() as memory:
        reading, writing = os.pipe()
        request = {
            "reading": reading,
            "block": memory.fileno(),
            "process": os.getpid(),
            "out": str(path),
            "drawn": drawn,
            "force": force,
        }
        with subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, json.dumps(request)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            pass_fds=(reading, memory.fileno()),
            env=our_environment(),
        ) as recorder:
            os.close(reading)
            watch = block.watch = start.watch(
                writing,
                os.dup(memory.fileno()),
                steps=steps,
                duration_s=duration_s,
                keep_sleeping=keep_sleeping,
                seed=seed,
            )
            how, error, site = "finished", "", ""
            try:
                yield block
            except Stop:
                how = "stopped"
            except BaseException as failure:
                how, error = "failed", ending.in_one_line(failure)
                site = ending.place_of(failure, __file__)
                raise
            finally:
                ours = os.getpid() == request["process"]
                if ours:
                    ending.end(watch, how, error, site)
                    watch.remove()
                    watch.pipe.close()
                    assert recorder.stdout is not None
                    answer = recorder.stdout.read()
                else:  # a forked child: the recording goes on without it
                    recorder.returncode = 0
    if not ours:
        return
    block.recorded = replace(_recorded(answer, path), recording=path)


def _recorded(answer: bytes, path: Path) -> Recorded:
    """Return the result that the process that writes the recording has sent."""
    if not answer:
        raise OutputError(
            "{path} was not written: the process that writes the recording ended; is there enough "
            "memory? Record it again",
            path=path,
        )
    result: dict[str, Any] = json.loads(answer)
    if "recording" not in result:
        raise OutputError("{error}", error=result["error"])
    return Recorded(**result)


def _record(request: dict[str, Any]) -> dict[str, Any]:
    """Record what comes through a pipe, and return the result."""
    began = time.perf_counter()
    path, recording_id = Path(request["out"]), uuid.uuid4().hex
    origin = {
        "kind": "script",
        "script": schema.BLOCK,
        "drop_version": metadata.version("drop-physics"),
    }
    recorder = Recorder({schema.ORIGIN_PROPERTY: origin}, drawn=request["drawn"])
    listener = BlockListener(request["reading"], request["block"], process=request["process"])
    ended = written(
        listener,
        recorder,
        path,
        recording_id=recording_id,
        force=request["force"],
        full=lambda: listener.stop("disk"),
    )
    recorded = recorded_of(recorder, ended, path, recording_id=recording_id, name=schema.BLOCK)
    wall_s = time.perf_counter() - began
    return asdict(recorded) | {"recording": str(path), "wall_s": wall_s}


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the block handles it, ends, and is recorded
    try:
        answer = _record(json.loads(sys.argv[1]))
    except MemoryError:
        answer = {"error": NO_MEMORY}
    except DropError as failure:
        answer = {"error": "; ".join([failure.in_options, *getattr(failure, "__notes__", [])])}
    with contextlib.suppress(BrokenPipeError):  # the block's process was killed
        os.write(1, json.dumps(answer).encode())

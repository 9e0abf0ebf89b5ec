"""Records a `with` block of Python that uses PyBullet or MuJoCo, in notebooks and tests.

    with record("run.rrd"):
        ...

A separate process writes the recording, so that the recording is complete even if this process
crashes, and Rerun need not be imported here. Calls of functions that were imported from pybullet by
name before the block (`from pybullet import stepSimulation`) are not recorded. Outside the block,
nothing is patched.
"""

from __future__ import annotations

import _socket  # `socket` may be forbidden in tests, as by pytest-socket
import os
import warnings
from array import array
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.engines.channel import shared_block, wide_pipe
from drop_physics.engines.watching import ending, start
from drop_physics.engines.watching.host import ScriptWatch, Stop
from drop_physics.errors import OutputError, check_suffix
from drop_physics.fields import counted
from drop_physics.files.outputs import check_target
from drop_physics.messages import Message
from drop_physics.stages.program import checked_limits
from drop_physics.workers import Worker, WorkerDiedError

if TYPE_CHECKING:
    from drop_physics.stages.record import Recorded


NO_STEP = (
    "nothing was simulated in this block: it made no step, or with functions that were imported by "
    "name before (from pybullet import stepSimulation), which are not seen"
)


class Block:
    """A recorded block of Python; after its end, printing it prints the result of the recording."""

    watch: ScriptWatch
    written: dict[str, Any] | None = None
    """Values of the recording's result, once the block has ended."""

    @property
    def recorded(self) -> Recorded | None:
        """The recording's result; None until the block has ended."""
        from drop_physics.stages.record import Recorded

        return None if self.written is None else Recorded(**self.written)

    @property
    def steps(self) -> int:
        """Number of steps recorded so far."""
        return self.watch.steps_made

    def __repr__(self) -> str:
        recorded = self.recorded
        so_far = Message("being recorded, {steps} so far", steps=counted(self.steps, "step"))
        return so_far if recorded is None else str(recorded)

    def _repr_html_(self) -> str | None:
        recorded = self.recorded
        return None if recorded is None else recorded._repr_html_()


class BlockWriter(Worker):
    """A process that writes recordings of blocks, and finishes even if this process crashes."""

    def __init__(self) -> None:
        self._handing, taking = _socket.socketpair()
        super().__init__(finishes=True, pass_fds=[taking.fileno()])
        self._place = taking.fileno()
        taking.close()

    def close(self) -> None:
        """End the process once it has finished writing."""
        super().close()
        self._handing.close()

    def begin(self, reading: int, memory: int, *how: object) -> None:
        """Start writing a stream from a pipe; send the process both file descriptors."""
        self.ask("drop_physics.stages.block.writer:write", self._place, *how)
        both = array("i", [reading, memory])
        self._handing.sendmsg([b"\0"], [(_socket.SOL_SOCKET, _socket.SCM_RIGHTS, both)])


@contextmanager
def record(
    out: Path | str,
    *,
    steps: int | None = None,
    duration_s: float | None = None,
    seed: int | None = None,
    keep_sleeping: bool = False,
    drawn: bool = True,
    verified: bool = True,
    force: bool = False,
    writer: BlockWriter | None = None,
) -> Iterator[Block]:
    """Record the use of PyBullet or MuJoCo in a `with` block, as `drop record` does for a script.

    Parameters
    ----------
    out
        The recording to write.
    steps, duration_s
        Number of steps, and simulated time [s], after which the block ends; None for no limit.
    seed
        The seed of `random`, `numpy.random`, and numpy's `SeedSequence`; None to set no seed.
    keep_sleeping
        Whether `sleep` in the block really waits.
    drawn
        Whether the recording includes entities that are only for display: shapes, poses, curves.
    verified
        Whether the recording is read back and verified at once; otherwise, damage is noticed when
        it is read later.
    force
        Whether an existing recording may be replaced.
    writer
        The process that writes the recording; None to start one for this block.

    Raises
    ------
    ScenarioError
        If a limit is not above 0.
    OutputError
        If the recording cannot be written.
    """
    path, block, process = Path(out), Block(), os.getpid()
    check_target(path, force=force)
    check_suffix("out", path, (".rrd",))
    steps, duration_s, seed = checked_limits(steps, duration_s, seed)
    alone = writer is None
    with ExitStack() as open_until_written:
        memory = open_until_written.enter_context(shared_block())
        if writer is None:
            writer = open_until_written.enter_context(BlockWriter())
        reading, writing = wide_pipe()
        writer.begin(reading, memory.fileno(), path, process, drawn, verified, force)
        os.close(reading)
        watch = block.watch = start.watch(
            writing,
            os.dup(memory.fileno()),
            steps=steps,
            duration_s=duration_s,
            keep_sleeping=keep_sleeping,
            seed=seed,
        )
        how, error, site = "finished", "", ending.NOWHERE
        try:
            yield block
        except Stop:
            how = "stopped"
        except BaseException as failure:
            how, error = "failed", ending.in_one_line(failure)
            site = ending.place_of(failure, __file__)
            raise
        finally:
            if os.getpid() == process:  # else a forked child: the recording goes on without it
                ending.end(watch, how, error, site)
                watch.remove()
                watch.pipe.close()
                block.written = _answer(writer, path)
        if not block.steps and alone:
            warnings.warn(NO_STEP, stacklevel=3)  # of the `with` statement


def _answer(writer: BlockWriter, path: Path) -> dict[str, Any]:
    try:
        written: dict[str, Any] = writer.answer()
    except WorkerDiedError:
        raise OutputError(
            "{path} was not written: the process that writes the recording ended; is there enough "
            "memory? Record it again",
            path=path,
        ) from None
    return written

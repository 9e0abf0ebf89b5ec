"""Who runs the shards: this process, a pool of processes, or Ray. The work is the same.

Each engine takes a function of a shard's number, asks for shards only as workers become free, and
yields results as they come, in any order. A worker that dies takes nothing with it: its shard is
run again, and a result counts when it is yielded, once.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import multiprocessing
import os
import signal
import socket
import tempfile
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import DropError

T = TypeVar("T")

QUEUED = 2
"""Shards per worker that are on their way: one at work, one waiting."""
HEARTBEAT_S = 0.2
"""Waiting is interrupted so often: a signal that another thread receives interrupts none."""
MOST_DEATHS = 10
"""A shard that was under way in so many deaths of a pool is taken for their cause."""


def in_this_process(work: Callable[[int], T], shards: Iterable[int]) -> Generator[tuple[int, T]]:
    """Run shards one after another."""
    for shard in shards:
        yield shard, work(shard)


# -- processes ------------------------------------------------------------------------------------


def in_processes(
    work: Callable[[int], T], shards: Iterable[int], *, jobs: int
) -> Generator[tuple[int, T]]:
    """Run shards in a pool of processes of this machine.

    Parameters
    ----------
    work
        Function of a shard's number; picklable, and so are its results. They should be small: a
        worker that is killed while it hands over more than a pipe takes at once would be waited
        for in vain.
    shards
        Their numbers.
    jobs
        How many processes.

    Raises
    ------
    DropError
        If workers die again and again.
    """
    todo, again, deaths = iter(shards), deque[int](), Counter[int]()
    while True:
        under_way: dict[Future[T], int] = {}
        try:
            with _pool(jobs) as pool:
                while True:
                    while len(under_way) < jobs * QUEUED:
                        shard = again.popleft() if again else next(todo, None)
                        if shard is None:
                            break
                        try:
                            under_way[pool.submit(work, shard)] = shard
                        except BrokenProcessPool:
                            again.append(shard)
                            raise
                    if not under_way:
                        return
                    for future in wait(under_way, HEARTBEAT_S, FIRST_COMPLETED).done:
                        result = future.result()
                        yield under_way.pop(future), result
        except BrokenProcessPool:
            # Nobody says whose shard it was: all that were under way are run again.
            again.extend(sorted(under_way.values()))
            deaths.update(again)
            for shard, count in deaths.items():
                if count >= MOST_DEATHS:
                    raise DropError(
                        f"workers died {count} times, each time with shard {shard} under way; is "
                        "there enough memory? Try fewer --jobs, or --jobs 1 to see what happens"
                    ) from None


READY = ("typer", "pipeline.budget.decomposition", "pipeline.physics.lasting_world")
"""What workers have imported when they start: all that a run needs, but not polars.

Importing polars starts threads, and a fork would leave their locks locked.
"""


@functools.cache
def _context() -> BaseContext:
    """Return how workers start: forked from a process that has nothing but imports in it."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")  # Windows
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(READY))
    return context


def get_ready() -> None:
    """Let the workers' imports begin, while this process is still busy with its own."""
    if _context().get_start_method() == "forkserver":
        # Ctrl-C, which a terminal sends to every process, is for this one alone to answer.
        resource_tracker.ensure_running()  # which would let the signal in again
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextlib.contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Start workers that end with the block, at once where it ends with an exception."""
    get_ready()
    context = _context()
    life, ours = context.Pipe(duplex=False)
    with life, ours:
        pool = ProcessPoolExecutor(jobs, context, initializer=_live_with, initargs=(life,))
        try:
            yield pool
            pool.shutdown()
        except BaseException:
            ours.close()
            pool.shutdown(cancel_futures=True)
            raise


def _live_with(life: Connection) -> None:
    """End this worker as soon as the other end of a pipe is closed, whatever it is doing.

    So a worker outlives neither its pool nor, whatever kills that, the process it belongs to. It
    leaves Ctrl-C, which a terminal sends to every process, to that one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def wait_for_the_end() -> None:
        with contextlib.suppress(EOFError, OSError):
            life.recv()
        os._exit(1)

    threading.Thread(target=wait_for_the_end, daemon=True).start()


# -- Ray ------------------------------------------------------------------------------------------


def on_ray(
    work: Callable[[int], T], shards: Iterable[int], *, address: str
) -> Generator[tuple[int, T]]:
    """Run shards on a Ray cluster, whose nodes must see the same files under the same names.

    Ray runs a task again whose worker or node died. Where this process is connected to a cluster
    already, that one is used and the connection stays.

    Parameters
    ----------
    work, shards
        As for `in_processes`.
    address
        Of the cluster, `auto` for the one that this machine belongs to, or `local` for one of its
        own.

    Raises
    ------
    DropError
        If Ray is not installed or no cluster answers.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise DropError("--ray needs Ray; try: pip install 'drop-physics[ray]'") from None
    ours = not ray.is_initialized()
    if ours:
        _connect(address)
    under_way: dict[Any, int] = {}
    try:
        run: Any = ray.remote(max_retries=MOST_DEATHS)(_call)
        todo, carried = iter(shards), ray.put(work)
        cluster: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        most = QUEUED * max(1, int(cluster.get("CPU", 1)))
        while True:
            while len(under_way) < most and (shard := next(todo, None)) is not None:
                under_way[run.remote(carried, shard)] = shard
            if not under_way:
                return
            for task in ray.wait(list(under_way), timeout=HEARTBEAT_S)[0]:
                result = ray.get(task)
                yield under_way.pop(task), result
    finally:
        for task in under_way:
            ray.cancel(task, force=True)
        if ours:
            ray.shutdown()


def _connect(address: str) -> None:
    import ray

    known = Path(tempfile.gettempdir(), "ray", "ray_current_cluster")
    place = os.environ.get("RAY_ADDRESS") or address
    if place == "auto" and known.exists():  # where `ray start` notes it, and a crash leaves it
        place = known.read_text().strip()
    host, _, port = place.removeprefix("ray://").rpartition(":")
    try:
        if host and port.isdecimal():  # Ray itself would try for minutes
            socket.create_connection((host, int(port)), timeout=5).close()
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError) as error:
        words = str(error).strip().partition("\n")[0].rstrip(".")
        raise DropError(
            f"no Ray cluster answers at {address!r} ({words}); start one with: ray start --head"
        ) from None


def _call(work: Callable[[int], T], shard: int) -> T:
    return work(shard)

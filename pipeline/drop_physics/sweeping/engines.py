"""Engines that run the shards: threads, a pool of processes, or Ray. The work is the same.

Each engine takes a function of a shard's number, requests shards only as workers become free, and
yields results as they arrive, in any order. If a worker dies nothing is lost: its shard is run
again, and each result is yielded once.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, TypeVar

from drop_physics.errors import DropError
from drop_physics.workers import Worker, WorkerDiedError, cores

T = TypeVar("T")

QUEUED = 2
"""Shards per processor of a cluster that are submitted: one at work, one waiting."""
HEARTBEAT_S = 0.2
"""Waiting is interrupted this often, because a signal to another thread does not interrupt it."""
MOST_DEATHS = 10
"""A shard on which this many workers have died is considered the cause."""

HOME = Path(__file__).parents[2]
"""The folder of this package, which is on the module path wherever this runs."""
ANSWERS_WITHIN_S = 5.0
"""A cluster that does not answer within this time counts as not running."""
HTTP2_SETTINGS = b"\x04"
HTTP2_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + HTTP2_SETTINGS + bytes(5)
"""The first bytes of a client of HTTP/2, which Ray uses: the preface and empty settings (RFC
9113, 3.4). The server answers with its own settings, a frame whose fourth byte is its type."""


def in_threads(
    work: Callable[[int], T], shards: Iterable[int], *, jobs: int, stop: Callable[[], None]
) -> Generator[tuple[int, T]]:
    """Run shards in threads of this process, which wait for processes of their own.

    Parameters
    ----------
    work
        Function of a shard's number.
    shards
        Their numbers.
    jobs
        How many threads.
    stop
        Called when nobody wants the results that are left, to end what is at work.
    """
    todo, under_way = iter(shards), dict[Future[T], int]()
    with ThreadPoolExecutor(jobs) as threads:
        try:
            while True:
                while len(under_way) < jobs and (shard := next(todo, None)) is not None:
                    under_way[threads.submit(work, shard)] = shard
                if not under_way:
                    return
                for future in wait(under_way, HEARTBEAT_S, FIRST_COMPLETED).done:
                    yield under_way.pop(future), future.result()
        finally:
            if under_way:
                stop()


# -- processes ------------------------------------------------------------------------------------


def in_processes(
    work: Callable[[int], T], shards: Iterable[int], *, jobs: int
) -> Generator[tuple[int, T]]:
    """Run shards in processes of this machine.

    Parameters
    ----------
    work
        Function of a shard's number; picklable, and so are its results.
    shards
        Their numbers.
    jobs
        How many processes.

    Raises
    ------
    DropError
        If workers cannot be started, or die repeatedly on one shard.
    """
    stopped = threading.Event()

    def run(shard: int) -> T:
        """Return what a worker answers, another where one dies."""
        for _ in range(MOST_DEATHS):
            worker = free.pop()
            try:
                answer = _answer(worker, work, shard)
            except WorkerDiedError:
                if not stopped.is_set():
                    free.append(workers.enter_context(_started()))
                if stopped.is_set():  # perhaps since then
                    raise
                worker.close()
            else:
                free.append(worker)
                return answer
        raise DropError(
            "workers died {deaths} times on shard {shard}; is there enough memory? "
            "Try fewer --jobs, or --jobs 1 to see what happens",
            deaths=MOST_DEATHS,
            shard=shard,
        )

    def stop() -> None:
        stopped.set()
        workers.close()

    # A thread for each worker waits for its answer; it ends when the worker has ended.
    with contextlib.ExitStack() as workers:
        free = [
            workers.enter_context(_waiting.pop() if _waiting else _started()) for _ in range(jobs)
        ]
        yield from in_threads(run, shards, jobs=jobs, stop=stop)


def _answer(worker: Worker, work: Callable[[int], T], shard: int) -> T:
    worker.ask(f"{__name__}:_call", work, shard)
    answer: T = worker.answer()
    return answer


_waiting: list[Worker] = []
"""Workers that were started in advance."""


def get_ready(jobs: int | None) -> None:
    """Start the workers' imports while this process is still busy with its own."""
    most = cores()
    _waiting.extend(_started() for _ in range(min(jobs or most, most)))


def dismiss() -> None:
    """End the workers that were started in advance and not needed."""
    while _waiting:
        _waiting.pop().close()


def _started() -> Worker:
    worker = Worker()
    worker.load("drop_physics.stages.sweep_shard")
    return worker


# -- Ray ------------------------------------------------------------------------------------------


def on_ray(
    work: Callable[[int], T], shards: Iterable[int], *, address: str
) -> Generator[tuple[int, T]]:
    """Run shards on a Ray cluster, whose nodes must share a file system.

    Ray reruns a task whose worker or node died. If this process is already connected to a cluster,
    that one is used, and the connection is kept.

    Parameters
    ----------
    work, shards
        As for `in_processes`.
    address
        Of the cluster; `auto` for the one that this machine belongs to, or `local` for a new one.

    Raises
    ------
    DropError
        If Ray is not installed or no cluster answers.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise DropError("--ray needs Ray; try: pip install ray") from None
    ours = not ray.is_initialized()
    if ours:
        _connect(address)
    under_way: dict[Any, int] = {}
    try:
        run: Any = ray.remote(max_retries=MOST_DEATHS)(_call_in)
        todo, shared_work, here = iter(shards), ray.put(work), Path.cwd()
        cluster: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        most = QUEUED * max(1, int(cluster.get("CPU", 1)))
        while True:
            while len(under_way) < most and (shard := next(todo, None)) is not None:
                under_way[run.remote(here, shared_work, shard)] = shard
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

    note = Path(tempfile.gettempdir(), "ray", "ray_current_cluster")
    target = os.environ.get("RAY_ADDRESS") or address
    if target == "auto" and note.exists():  # `ray start` writes it, and a crash leaves it behind
        target = note.read_text().strip()
    host, _, port = target.removeprefix("ray://").rpartition(":")
    try:
        if host and port.isdecimal():  # Ray itself would try for minutes
            with socket.create_connection((host, int(port)), timeout=ANSWERS_WITHIN_S) as probe:
                probe.sendall(HTTP2_HELLO)
                if probe.recv(9)[3:4] != HTTP2_SETTINGS:
                    raise DropError(
                        "no Ray cluster answers at {address!r}: another server listens there; "
                        "start one with: ray start --head",
                        address=address,
                    )
        # Workers get the working directory on their module path: for now that is where we are.
        with contextlib.chdir(HOME):
            ray.init(address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError) as error:
        raise DropError(
            "no Ray cluster answers at {address!r} ({reason}); start one with: ray start --head",
            address=address,
            reason=str(error).strip().partition("\n")[0].rstrip("."),
        ) from None


def _call_in(folder: Path, work: Callable[[int], T], shard: int) -> T:
    with contextlib.suppress(OSError):  # a node without it has no bodies there
        os.chdir(folder)
    return _call(work, shard)


def _call(work: Callable[[int], T], shard: int) -> T:
    return work(shard)

"""Executes many runs at once: in threads, worker processes, or on a Ray cluster.

The functions take a function that executes a run, given its number. They request a run only when a
thread or process is free, and yield results as they arrive, in any order. If a worker dies, its run
is repeated.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, TypeVar

from drop_physics.errors import DropError
from drop_physics.workers import Worker, WorkerDiedError

R = TypeVar("R")
T = TypeVar("T")
Answering = tuple[Callable[[int], T], Callable[[], None], int]
"""Function that executes a run, function that stops all runs in progress, and the number of
concurrent runs."""

QUEUED = 2
"""Number of runs submitted per processor of a cluster: one that runs, and one that waits."""
HEARTBEAT_S = 0.2
"""Interval at which waiting is interrupted [s], since a signal to another thread does not interrupt
it."""
MOST_DEATHS = 10
"""Number of workers that have to die on the same run before the run counts as the cause."""

HOME = Path(__file__).parents[2]
"""Folder that contains this package, which is added to the module path of every machine."""
ANSWERS_WITHIN_S = 5.0
"""Time within which a cluster must respond to count as running [s]."""
HTTP2_SETTINGS = b"\x04"
HTTP2_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + HTTP2_SETTINGS + bytes(5)
"""First bytes sent by a client of HTTP/2, which Ray uses: the preface and empty settings (RFC 9113,
3.4). The server responds with its own settings, a frame whose fourth byte is its type."""


def in_threads(
    work: Callable[[R], T], runs: Iterable[R], *, jobs: int, stop: Callable[[], None]
) -> Generator[tuple[R, T]]:
    """Execute runs in threads of this process, each of which waits for a process.

    Parameters
    ----------
    work
        Function that executes a run, given its number or another identifier.
    runs
        The identifiers of the runs; the iterator is asked again after its end, as long as runs are
        in progress.
    jobs
        The number of threads.
    stop
        A function that ends the runs in progress; called if the caller stops before the last
        result.
    """
    todo, under_way = iter(runs), dict[Future[T], R]()
    with ThreadPoolExecutor(jobs) as threads:
        try:
            while True:
                while len(under_way) < jobs and (run := next(todo, None)) is not None:
                    under_way[threads.submit(work, run)] = run
                if not under_way:
                    return
                for future in wait(under_way, HEARTBEAT_S, FIRST_COMPLETED).done:
                    yield under_way.pop(future), future.result()
        finally:
            if under_way:
                stop()


@contextlib.contextmanager
def in_workers(work: Callable[[int], T], *, jobs: int) -> Iterator[Answering[T]]:
    """Yield a function that executes work in worker processes, and one that stops them.

    Parameters
    ----------
    work
        Picklable function that executes a run, given its number, and returns a picklable result.
    jobs
        The number of processes.

    Raises
    ------
    DropError
        If workers cannot be started, or die repeatedly on the same run.
    """
    stopped = threading.Event()

    def answer(run: int) -> T:
        """Return the result of a run from a worker, or from another worker if that one dies."""
        for _ in range(MOST_DEATHS):
            worker = free.pop()
            try:
                worker.ask(f"{__name__}:_call", work, run)
                answered: T = worker.answer()
            except WorkerDiedError:
                if not stopped.is_set():
                    free.append(workers.enter_context(Worker()))
                if stopped.is_set():  # perhaps since then
                    raise
                worker.close()
            else:
                free.append(worker)
                return answered
        raise DropError(
            "workers died {deaths} times on run {run}; is there enough memory? "
            "Try fewer --jobs, or --jobs 1 to see what happens",
            deaths=MOST_DEATHS,
            run=run,
        )

    def stop() -> None:
        stopped.set()
        workers.close()

    # A thread for each worker waits for its answer; it ends when the worker has ended.
    with contextlib.ExitStack() as workers:
        free = [workers.enter_context(Worker()) for _ in range(jobs)]
        yield answer, stop, jobs


# -- Ray ------------------------------------------------------------------------------------------


def on_ray(
    work: Callable[[int], T], runs: Iterable[int], *, address: str
) -> Generator[tuple[int, T]]:
    """Execute runs on a Ray cluster, whose nodes must share a file system.

    Ray repeats a task whose worker or node dies. If this process is already connected to a cluster,
    this cluster is used, and the connection is kept.

    Parameters
    ----------
    work
        The same as in `in_workers`.
    runs
        The numbers of the runs.
    address
        The address of the cluster; `auto` for the cluster of this machine, or `local` for a new
        one.

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
        call: Any = ray.remote(max_retries=MOST_DEATHS)(_call_in)
        todo, shared_work, here = iter(runs), ray.put(work), Path.cwd()
        cluster: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        most = QUEUED * max(1, int(cluster.get("CPU", 1)))
        while True:
            while len(under_way) < most and (run := next(todo, None)) is not None:
                under_way[call.remote(here, shared_work, run)] = run
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


def _call_in(folder: Path, work: Callable[[int], T], run: int) -> T:
    with contextlib.suppress(OSError):  # a node without it has no bodies there
        os.chdir(folder)
    return _call(work, run)


def _call(work: Callable[[int], T], run: int) -> T:
    return work(run)

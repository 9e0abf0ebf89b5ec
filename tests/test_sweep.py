"""Sweeps: rows do not depend on how they are run, and every row equals a separate drop's."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pybullet_data
import pytest
from command import HANGS_S, wait_for
from conftest import Drop, descendants_of, some
from drop_physics import Scenario, analyze
from drop_physics.engines.pybullet.engine import p
from drop_physics.errors import DropError, OutputError
from drop_physics.files.outputs import part_of
from drop_physics.recording.reader import read
from drop_physics.stages.sweep import Sweep, sweep
from drop_physics.stages.sweep.drop import RunDrop
from drop_physics.sweeping import engines
from drop_physics.sweeping.plan import plan_of
from drop_physics.sweeping.rows import TERMS, Row
from shards import always_dies, double, first_is_quick, nap

ARTICLE = ("--timestep", "1/240,1/480,1/960", "--linear-damping", "default,0")
HEIGHTS = {"samples": 40, "seed": 5, "vary": ["height=uniform:0.6:2"]}


def rows_of(swept: Sweep) -> list[dict[str, object]]:
    return swept.table().to_dicts()


# -- the article's table --------------------------------------------------------------------------


def test_the_articles_table_in_one_command(drop: Drop, tmp_path: Path) -> None:
    done = drop("sweep", *ARTICLE, "--out", "s")
    assert (done.returncode, done.stderr) == (0, "")
    for figure in (
        "-1.8203",
        "+1.2451",
        "+2.7777",
        "-6.1313",
        "-3.0656",
        "-1.5328",
        "+4.3102",
        "+0.0007",
    ):
        assert figure in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 100
    assert "\x1b" not in done.stdout
    assert {path.name for path in (tmp_path / "s").glob("*.rrd")} == {
        f"run-{run}.rrd" for run in range(6)
    }


def test_one_json_object_holds_every_run_and_what_they_tell(drop: Drop, tmp_path: Path) -> None:
    done = drop("sweep", *ARTICLE, "--out", "s", "--no-record", "--json")
    assert done.stderr == ""
    told = json.loads(done.stdout)
    assert (told["runs"], told["failed"]) == (6, 0)
    table = pl.read_parquet(tmp_path / told["results"]).to_dicts()
    assert told["table"] == table
    assert [(row["timestep_s"], row["linear_damping"]) for row in table] == [
        (1 / n, damping) for n in (240, 480, 960) for damping in (None, 0.0)
    ]
    assert set(TERMS) | set(Scenario.options()) <= set(table[0])
    assert table[0]["error_m"] == pytest.approx(-0.001820347613623, abs=1e-15)
    for row in table:
        assert sum(row[term] for term in TERMS[1:]) == pytest.approx(row["error_m"], abs=1e-16)
    assert not list((tmp_path / "s").glob("*.rrd"))


# -- a row is what a drop of its own gives --------------------------------------------------------

KINDS = [
    {},
    {"height_m": 0.3},  # at rest at 0.3 s
    {"height_m": 0.4},  # in contact
    {"velocity_m_s": (0.0, 0.0, 2.0)},
    {"velocity_m_s": (0.5, 0.0, 0.0)},  # oblique: no closed form
    {"spin_rad_s": (3.0, 0.0, 0.0)},
    {"coordinates": "maximal"},
    {"linear_damping": 1.0, "height_m": 50.0},
    {"gravity_m_s2": 0.0},
    {"stepped": False},
    {"floor": False, "height_m": 0.1},
    {"restitution": 0.7, "height_m": 0.2},
    {"body": "sphere_small.urdf", "mass_kg": 3.0},
    {"body": "r2d2.urdf"},  # has joints
]


@dataclass(frozen=True)
class Given:
    """A plan that consists of given scenarios, in their order."""

    kinds: tuple[dict[str, object], ...]
    samples: None = None

    @property
    def runs(self) -> int:
        """The number of scenarios."""
        return len(self.kinds)

    def values(self, run: int) -> dict[str, object]:
        """Return the fields of a scenario."""
        return self.kinds[run]

    def sample_of(self, _: int) -> None:
        """Return None, as no parameter is sampled."""


@pytest.mark.long
def test_a_row_has_the_numbers_of_drop_analyze(tmp_path: Path) -> None:
    """They agree to the last bit, airborne or not, whether or not there is a recording."""
    recorded = RunDrop(Given(tuple(KINDS)), tmp_path, "", 0.3, True, None)
    alone = RunDrop(Given(tuple(KINDS)), tmp_path / "alone", "", 0.3, False, None)
    for run, kind in enumerate(KINDS):
        row = recorded(run)
        assert row["error"] is None
        assert alone(run) == {**row, "recording": None}
        path = tmp_path / str(row["recording"])
        (moment,) = analyze(path, at_s=[0.3]).at
        terms = moment.terms_m
        assert [row[name] for name in ("step", "time_s", "phase", "simulated_m", "error_m")] == [
            moment.step,
            moment.time_s,
            moment.phase,
            moment.simulated_m,
            moment.error_m,
        ], kind
        assert [row[term] for term in TERMS[1:]] == (
            [None] * 4
            if terms is None
            else [terms.timestep, terms.damping, terms.interaction, terms.rounding]
        ), kind
        assert row["end_m"] == read(path).seen.bases["position_m"][-1, 2]


def test_a_row_can_be_replayed_alone_to_the_last_bit(tmp_path: Path, drop: Drop) -> None:
    plan = plan_of(
        {"linear_damping": "0.01,default"},
        samples=2,
        seed=7,
        vary=["height=uniform:0.6:2", "spin_y=normal:0:3", "gravity=normal:-9:1"],
    )
    swept = sweep(plan, tmp_path / "s")
    row = rows_of(swept)[3]
    words = shlex.split(str(row["command"]))
    assert drop(*words[1:]).returncode == 0
    replayed, kept = read(tmp_path / "run-3.rrd"), read(tmp_path / "s" / str(row["recording"]))
    assert replayed.states.equals(kept.states)
    assert replayed.scenario == kept.scenario


# -- worlds ---------------------------------------------------------------------------------------


def test_a_sweep_leaves_no_world_behind(tmp_path: Path) -> None:
    """PyBullet calls without a client id use the first client that exists."""

    def connected() -> list[int]:
        return [client for client in range(64) if p.isConnected(client)]

    before = connected()
    sweep(plan_of({"height_m": "1,2"}), tmp_path / "s", record=False, jobs=1)
    assert connected() == before


# -- the same for any number of workers -----------------------------------------------------------


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> pl.DataFrame:
    """Return the rows of a sweep run by one process."""
    folder = tmp_path_factory.mktemp("reference")
    return sweep(plan_of({}, **HEIGHTS), folder, record=False, jobs=1).table()


@pytest.mark.long
def test_processes_give_the_same_bits(tmp_path: Path, reference: pl.DataFrame) -> None:
    reports: list[tuple[int, int, int]] = []
    swept = sweep(
        plan_of({}, **HEIGHTS),
        tmp_path,
        record=False,
        jobs=2,
        progress=lambda *report: reports.append(report),
    )
    assert swept.table().equals(reference)
    assert reports[0] == (0, 0, 40)
    assert reports[-1] == (40, 0, 40)


@pytest.mark.long
@pytest.mark.needs("ray")
@pytest.mark.filterwarnings("ignore:.*:ResourceWarning", "ignore:.*:DeprecationWarning:ray")
@pytest.mark.filterwarnings("ignore:Tip. In future versions of Ray:FutureWarning")
def test_ray_gives_the_same_bits(tmp_path: Path, reference: pl.DataFrame) -> None:
    """A private cluster on loopback: head, scheduler and workers are processes."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray

    ray.init(
        "local",
        num_cpus=2,
        _node_ip_address="127.0.0.1",
        include_dashboard=False,
        log_to_driver=False,
        logging_level="ERROR",
    )
    try:
        swept = sweep(plan_of({}, **HEIGHTS), tmp_path, record=False, ray="auto")
        assert ray.is_initialized()
    finally:
        ray.shutdown()
    assert swept.table().equals(reference)


@pytest.mark.needs("ray")
def test_a_ray_that_does_not_answer_gets_one_line(drop: Drop) -> None:
    done = drop("sweep", "--out", "s", "--ray", "127.0.0.1:9")
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert "ray start --head" in done.stderr


@pytest.mark.needs("ray")
@pytest.mark.parametrize("said", [b"", b"220 mail.example ESMTP\r\n"])
def test_what_listens_but_is_no_ray_gets_one_line(
    said: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ray itself would retry for minutes."""
    monkeypatch.setattr(engines, "ANSWERS_WITHIN_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            with connection, contextlib.suppress(ConnectionResetError):
                connection.sendall(said)
                while connection.recv(99):
                    pass

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        address = f"127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(DropError, match=f"no Ray cluster answers at '{address}'"):
            engines._connect(address)
        thread.join()


@dataclass(frozen=True)
class DiesOnce:
    """A worker's task whose process is killed once, in the middle of a run."""

    work: RunDrop
    run: int

    def __call__(self, run: int) -> Row:
        """Make the run, or kill the process."""
        flag = self.work.folder / "died"
        if run == self.run and not flag.exists():
            self.work(run)
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return self.work(run)


@pytest.mark.long
def test_a_killed_workers_run_is_made_again(tmp_path: Path) -> None:
    work = DiesOnce(RunDrop(plan_of({}, **HEIGHTS), tmp_path, "", 0.3, False, None), 7)
    done = dict(answers(work, range(40), jobs=2))
    assert (tmp_path / "died").exists()
    assert sorted(row["run"] for row in done.values()) == list(range(40))


def answers(
    work: Callable[[int], Any], runs: Iterable[int], *, jobs: int
) -> Generator[tuple[int, Any]]:
    """Yield the return values of worker processes, as a sweep receives them."""
    with engines.in_workers(work, jobs=jobs) as (answer, stop, at_once):
        yield from engines.in_threads(answer, runs, jobs=at_once, stop=stop)


def test_workers_use_no_semaphore_that_outlives_a_kill(monkeypatch: pytest.MonkeyPatch) -> None:
    def semaphore(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr("multiprocessing.synchronize.SemLock.__init__", semaphore)
    assert sorted(answers(double, range(3), jobs=2)) == [(0, 0), (1, 2), (2, 4)]
    with pytest.raises(OutputError, match="three"):
        list(answers(double, range(4), jobs=2))


def test_too_few_open_files_for_our_libraries_are_one_line(
    drop_process: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lack is detected before one of the libraries aborts."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20))

    for language in ("en", "ja"):
        monkeypatch.setenv("DROP_LANG", language)
        done = drop_process("sweep", "--out", "s", "--height", "1,2", preexec_fn=limited)
        assert (done.returncode, done.stdout) == (1, "")
        assert len(done.stderr.splitlines()) == 1, done.stderr
        assert "ulimit -n " in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_open_files_are_enough_or_one_line(drop_process: Drop) -> None:
    """The open files may run out anywhere in the process."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))

    done = drop_process(
        "sweep",
        "--out",
        "s",
        "--samples",
        "8",
        "--vary",
        "height=uniform:1:2",
        "--no-record",
        "--jobs",
        "2",
        preexec_fn=limited,
    )
    if done.returncode == 0:
        assert done.stderr == ""
        return
    assert (done.returncode, done.stdout) == (1, "")
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "Too many open files" in done.stderr


def test_a_lack_of_memory_is_no_failure_of_a_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A row would store the failure for good."""

    def lacks(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(RunDrop, "_fall", lacks)
        with pytest.raises(MemoryError):
            sweep(THREE, tmp_path, record=False, jobs=1)
    assert sweep(THREE, tmp_path, record=False, jobs=1).failed == 0


@pytest.mark.long
def test_stopping_in_the_middle_waits_for_nobody() -> None:
    """Workers and waiting threads may be in any state."""
    for _ in range(6):
        shards = answers(nap, range(10_000), jobs=2)
        for _ in range(5):
            next(shards)
        closing = threading.Thread(target=shards.close, daemon=True)
        closing.start()
        closing.join(HANGS_S)
        assert not closing.is_alive()


def test_who_wants_no_more_results_waits_for_no_run() -> None:
    results = answers(first_is_quick, range(100), jobs=2)
    assert next(results) == (0, 0)
    began = time.monotonic()
    results.close()
    assert time.monotonic() - began < 300, "it waits for the runs that are under way"


def test_a_run_that_kills_every_worker_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "MOST_DEATHS", 2)
    with pytest.raises(DropError, match="run 0"):
        list(answers(always_dies, range(1), jobs=1))


# -- going on, and not mixing ---------------------------------------------------------------------


def test_a_sweep_goes_on_where_it_stopped(tmp_path: Path, reference: pl.DataFrame) -> None:
    plan = plan_of({}, **HEIGHTS)

    def stop_at_ten(done: int, _: int, __: int) -> None:
        if done == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        sweep(plan, tmp_path, record=False, jobs=1, progress=stop_at_ten)
    assert "10 of 40 runs" in stopped.value.__notes__[0]
    assert not (tmp_path / "results.parquet").exists()
    rows = tmp_path / "rows.jsonl"
    rows.write_bytes(rows.read_bytes()[:-5])  # as a kill may leave it: of ten rows nine are whole
    swept = sweep(plan, tmp_path, record=False, jobs=1)
    assert (swept.runs, swept.computed) == (40, 31)
    assert swept.table().equals(reference)
    assert sweep(plan, tmp_path, record=False).computed == 0


@pytest.mark.parametrize(
    "change",
    some(
        [
            {"samples": 41},
            {"seed": 6},
            {"vary": ["height=uniform:0.6:3"]},
            {"given": {"linear_damping": "0"}},
            {"at_s": 0.2},
            {"record": True},
        ],
        2,
    ),
)
def test_another_sweep_is_turned_away(tmp_path: Path, change: dict[str, object]) -> None:
    plan = {"given": {}, "samples": 3, "seed": 5, "vary": ["height=uniform:0.6:2"]}
    how = {"at_s": 0.3, "record": False}
    sweep(plan_of(**plan), tmp_path, **how)
    before = (tmp_path / "results.parquet").read_bytes()
    plan |= {key: value for key, value in change.items() if key in plan}
    how |= {key: value for key, value in change.items() if key in how}
    with pytest.raises(OutputError, match="files of something else"):
        sweep(plan_of(**plan), tmp_path, **how)
    assert (tmp_path / "results.parquet").read_bytes() == before
    forced = sweep(plan_of(**plan), tmp_path, **how, force=True)
    assert forced.computed == forced.runs


@pytest.mark.long
def test_a_sweep_of_a_body_that_was_edited_is_another(tmp_path: Path) -> None:
    """The edit is in its URDF, or in a mesh that the URDF names."""
    folder, body = tmp_path / "s", tmp_path / "own.urdf"
    box = Path(pybullet_data.getDataPath(), "cube_small.urdf").read_text()
    body.write_text(box.replace("cube.obj", "own.obj"))
    mesh = Path(pybullet_data.getDataPath(), "cube.obj").read_text()
    (tmp_path / "own.obj").write_text(mesh)
    plan = plan_of({"body": str(body), "height_m": "1,2"})
    sweep(plan, folder, record=False)
    assert sweep(plan, folder, record=False).computed == 0
    (tmp_path / "own.obj").write_text(mesh + "# edited\n")
    with pytest.raises(OutputError, match="files of something else"):
        sweep(plan, folder, record=False)
    (tmp_path / "own.obj").write_text(mesh)
    body.write_text(body.read_text() + "\n")
    with pytest.raises(OutputError, match="files of something else"):
        sweep(plan, folder, record=False)


def test_recordings_that_were_there_before_are_not_replaced(tmp_path: Path) -> None:
    theirs = tmp_path / "run-2.rrd"
    theirs.write_text("precious")
    with pytest.raises(OutputError, match="has files of something else"):
        sweep(plan_of({"height_m": "1,2,3"}), tmp_path)
    assert theirs.read_text() == "precious"


THREE = plan_of({"height_m": "1,2,3"})


def test_a_recording_that_is_gone_is_made_again(tmp_path: Path) -> None:
    """It is equal to the byte, id included, whatever a killed worker left beside it."""
    first = sweep(THREE, tmp_path)
    path = tmp_path / "run-1.rrd"
    was, rows = read(path), first.table()
    path.unlink()
    part_of(path).write_bytes(b"left")
    again = sweep(THREE, tmp_path)
    assert (again.computed, again.table().equals(rows)) == (1, True)
    assert read(path).states.equals(was.states)
    assert read(path).recording_id == was.recording_id


@pytest.mark.parametrize("rows", [b"", b"[" * 100_000, b'{"sweep": "another"}\n{"run": 0}\n'])
def test_rows_that_are_not_this_sweeps_are_made_again(tmp_path: Path, rows: bytes) -> None:
    whole = sweep(THREE, tmp_path, record=False).table()
    (tmp_path / "rows.jsonl").write_bytes(rows)
    again = sweep(THREE, tmp_path, record=False)
    assert (again.computed, again.table().equals(whole)) == (3, True)


def test_two_sweeps_at_a_time_do_not_share_a_folder(tmp_path: Path) -> None:
    plan = plan_of({}, **HEIGHTS)

    def meanwhile(done: int, _: int, __: int) -> None:
        if done == 3:
            with pytest.raises(OutputError, match="another command is writing"):
                sweep(plan, tmp_path, record=False, jobs=1)

    assert sweep(plan, tmp_path, record=False, jobs=1, progress=meanwhile).runs == 40


# -- what fails -----------------------------------------------------------------------------------


def test_a_scenario_that_fails_is_a_row(drop: Drop, tmp_path: Path) -> None:
    done = drop(
        "sweep", "--out", "s", "--body", "cube_small.urdf,nope.urdf", "--duration", "0.3,0.3001"
    )
    assert done.returncode == 1
    assert done.stderr.startswith("drop: 3 of 4 runs failed; ")
    assert "3 of 4 runs failed" in done.stdout
    rows = pl.read_parquet(tmp_path / "s" / "results.parquet").sort("run").to_dicts()
    assert [row["error"] is None for row in rows] == [True, False, False, False]
    assert ["nope.urdf" in str(row["error"]) for row in rows] == [False, True, False, False]
    assert [row["duration_s"] for row in rows] == [0.3, 0.3, 0.3001, 0.3001]


def test_if_all_fail_the_sweep_has_failed(drop: Drop, tmp_path: Path) -> None:
    done = drop("sweep", "--out", "s", "--at", "5", "--no-record")
    assert (done.returncode, done.stdout) == (1, "")
    assert "drop: the run failed with: --at must" in done.stderr
    assert "--at must lie within" in done.stderr
    assert pl.read_parquet(tmp_path / "s" / "results.parquet")["error"].null_count() == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--timestep", "1/240,x"], "'x'"),
        (["--height", "1,-1"], "--height must be"),
        (["--jobs", "0"], "--jobs"),
        (["--at", "x"], "--at"),
        (["--at", "-1"], "--at"),
        (["--at", "inf"], "--at must be finite"),
        (["--at", "nan"], "--at must be finite"),
        (["--vary", "height=uniform:1:2"], "--samples"),
    ],
)
def test_wrong_usage_gets_one_line_and_leaves_nothing(
    drop: Drop, tmp_path: Path, options: list[str], said: str
) -> None:
    done = drop("sweep", "--out", "s", *options)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []


# -- chance ---------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_spread_is_that_of_the_rows_in_the_air(tmp_path: Path) -> None:
    """Only rows whose terms add up count; rows on the floor have a total only."""
    plan = plan_of({"linear_damping": "0,0.1"}, samples=30, seed=2, vary=["height=uniform:0.1:1"])
    swept = sweep(plan, tmp_path, record=False)
    printed = str(swept)
    assert "linear damping 0\n" in printed
    damped = swept.table().filter(pl.col("linear_damping") == 0.1)
    falling = damped.drop_nulls("timestep_m")
    assert 0 < len(falling) < len(damped) == 30
    for name, column in (("total", "error_m"), ("damping", "damping_m")):
        values_mm = 1e3 * falling[column].to_numpy()
        (row,) = re.findall(rf"^{name} +(.*)$", printed.partition("damping 0.1\n")[2], re.MULTILINE)
        mean, spread, *quantiles = map(float, row.split())
        assert mean == pytest.approx(values_mm.mean(), abs=6e-5)
        assert spread == pytest.approx(values_mm.std(ddof=1), abs=6e-5)
        assert quantiles == pytest.approx(np.quantile(values_mm, (0.05, 0.5, 0.95)), abs=6e-5)
    assert f"over the {len(falling)} of 30 samples in the air, in theory too" in printed
    low = plan_of({}, samples=5, vary=["height=uniform:0.1:0.2"])
    printed = str(sweep(low, tmp_path / "low", record=False))
    assert "over 5 samples; none was in the air, in theory too" in printed
    assert "timestep" not in printed


# -- a person at the terminal ---------------------------------------------------------------------


def rows_in(folder: Path) -> int:
    """Return the number of rows that a sweep in `s` has stored."""
    rows = folder / "s/rows.jsonl"
    return max(0, len(rows.read_bytes().splitlines()) - 1) if rows.exists() else 0


@pytest.fixture
def long_sweep(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Return a process that runs a minutes-long sweep with two workers."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "drop_physics",
            "sweep",
            "--out",
            "s",
            "--samples",
            "20000",
            "--jobs",
            "2",
            "--vary",
            "height=uniform:1:2",
            "--no-record",
        ],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
    )
    wait_for(lambda: rows_in(tmp_path) > 1 or process.poll() is not None, "no rows")
    assert process.poll() is None
    yield process
    if process.poll() is None:
        process.kill()
        process.communicate()


@pytest.mark.long
def test_interrupted_it_stops_at_once_and_says_how_to_go_on(
    long_sweep: subprocess.Popen[str], tmp_path: Path
) -> None:
    children = descendants_of(long_sweep.pid)
    assert len(children) == 2
    done = rows_in(tmp_path)
    long_sweep.send_signal(signal.SIGINT)
    stdout, stderr = long_sweep.communicate(timeout=HANGS_S)
    assert (long_sweep.returncode, stdout, len(stderr.splitlines())) == (130, "", 1)
    assert "of 20,000 runs done in s; run the same command again to resume" in stderr
    assert done <= rows_in(tmp_path) < 20_000
    assert_they_end(children)


@pytest.mark.long
def test_workers_do_not_outlive_whoever_started_them(long_sweep: subprocess.Popen[str]) -> None:
    children = descendants_of(long_sweep.pid)
    long_sweep.kill()
    long_sweep.communicate()
    assert_they_end(children)


def assert_they_end(processes: list[str]) -> None:
    wait_for(lambda: not any(map(_is_alive, processes)), "a worker was left behind")


def _is_alive(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False

"""Sweeps: the same rows however they are run, and every row is what a drop of its own gives."""

from __future__ import annotations

import contextlib
import json
import os
import random
import resource
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
import pybullet_data
import pytest
from command import HANGS_S, wait_for
from conftest import Drop, descendants_of
from drop_physics import Scenario, analyze
from drop_physics.drop.statistics import Moments
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.lasting_world import LastingWorld
from drop_physics.engines.pybullet.world import World
from drop_physics.engines.worlds import Worlds
from drop_physics.errors import DropError, OutputError, ScenarioError
from drop_physics.figures.convergence_plot import Refinement, build_figure
from drop_physics.figures.theme import LIGHT
from drop_physics.files.outputs import part_of
from drop_physics.recording.reader import read
from drop_physics.stages.sweep import Sweep, sweep
from drop_physics.stages.sweep_shard import RunShard, ShardDone
from drop_physics.sweeping import engines
from drop_physics.sweeping.folder import TERMS
from drop_physics.sweeping.plan import plan_of
from drop_physics.trace.states import BODY
from drop_physics.workers import Worker
from dropped import dropped_whole
from shards import always_dies, double, first_is_quick, nap

ARTICLE = ("--timestep", "1/240,1/480,1/960", "--linear-damping", "default,0")
HEIGHTS = {"samples": 40, "seed": 5, "vary": ["height=uniform:0.6:2"]}


def rows_of(swept: Sweep) -> list[dict[str, object]]:
    return swept.table().to_dicts()


# -- the article's table --------------------------------------------------------------------------


def test_the_articles_table_in_one_command(drop: Drop, tmp_path: Path) -> None:
    done = drop("sweep", *ARTICLE, "--out", "s", "--plot", "errors.svg")
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
        "0.55",
        "-1.16",
        "meaningless",
        "1.000",
        "0.562860 m",
        "0.3412%",
        "0.2730%",
        "1/341 s",
        "refining hurts",
        "+4.31 mm",
    ):
        assert figure in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 100
    assert "\x1b" not in done.stdout
    plot = (tmp_path / "errors.svg").read_text()
    assert all(f">{name}<" in plot for name in ("total", "timestep", "damping", "interaction"))
    assert {path.name for path in (tmp_path / "s" / "recordings").iterdir()} == {
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
    damped, undamped = told["convergence"]
    assert (damped["linear_damping"], undamped["linear_damping"]) == (None, 0.0)
    assert damped["study"]["refining_hurts"]
    assert not undamped["study"]["refining_hurts"]
    assert not (tmp_path / "s" / "recordings").exists()


def test_other_fields_and_times_that_do_not_match_are_not_mixed(tmp_path: Path) -> None:
    """1/240 s and 1/250 s have a sample at 0.3 s; the one of 1/64 s is at 0.296875 s."""
    plan = plan_of({"timestep_s": "1/64,1/240,1/250", "height_m": "1,2"})
    swept = sweep(plan, tmp_path / "s", record=False)
    assert [group.values for group in swept.studies] == [{"height_m": 1.0}, {"height_m": 2.0}]
    assert [group.label for group in swept.studies] == ["height 1", "height 2"]
    assert [group.left_out_s for group in swept.studies] == [(1 / 64,)] * 2
    assert "errors at the samples nearest to 0.3 s in mm" in str(swept)
    plan = plan_of({"timestep_s": "1/240,1/250,1/64"})
    study = sweep(plan, tmp_path / "t", record=False).studies[0].study
    assert study is not None
    exact = sweep({"timestep_s": [1 / 240, 1 / 250]}, tmp_path / "u", record=False)
    assert "errors at 0.3 s in mm" in str(exact)
    assert [run.timestep_s for run in study.runs] == [1 / 240, 1 / 250]


def test_timesteps_whose_errors_are_not_broken_down_have_no_study(tmp_path: Path) -> None:
    plan = plan_of({"timestep_s": "1/240,1/480"})
    assert sweep(plan, tmp_path / "s", record=False, at_s=0.5).studies == []


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
    """A plan of any scenarios, in their order."""

    kinds: tuple[dict[str, object], ...]
    samples: None = None

    @property
    def runs(self) -> int:
        """How many there are."""
        return len(self.kinds)

    def values(self, run: int) -> dict[str, object]:
        """Return the fields of one."""
        return self.kinds[run]

    def sample_of(self, _: int) -> None:
        """Return None: nothing is sampled."""


@pytest.mark.long
def test_a_row_has_the_numbers_of_drop_analyze(tmp_path: Path) -> None:
    """To the last bit, in the air and out of it, whether or not there is a recording."""
    recorded = RunShard(Given(tuple(KINDS)), tmp_path, 0.3, True, None)
    alone = RunShard(Given(tuple(KINDS)), tmp_path / "alone", 0.3, False, None)
    for run, kind in enumerate(KINDS):
        row = recorded.row(run)
        assert row["error"] is None
        assert alone.row(run) == {**row, "recording": None}
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


@pytest.mark.long
def test_a_kept_world_gives_the_bits_of_a_new_one() -> None:
    """Scenarios in random order, among them some that start in the floor, after others at rest."""
    chance = random.Random(1)

    def scenario() -> Scenario:
        return Scenario(
            height_m=chance.choice([0.02, 0.0249, 0.025, 0.3, 1.0]),
            timestep_s=chance.choice([1 / 240, 1 / 120]),
            gravity_m_s2=chance.choice([-9.81, -1.62, -30.0]),
            velocity_m_s=(chance.uniform(-1, 1), 0.0, chance.uniform(-3, 3)),
            spin_rad_s=chance.choice([(0.0, 0.0, 0.0), (2.0, -3.0, 1.0)]),
            linear_damping=chance.choice([0.0, 0.04, 0.5]),
            angular_damping=chance.choice([0.0, 0.3]),
            mass_kg=chance.uniform(0.05, 2),
            orientation=chance.choice([(0.0, 0.0, 0.0), (30.0, -20.0, 5.0), (1.0, 2.0, 3.0, 4.0)]),
            restitution=chance.choice([0.0, 0.5, 0.9]),
            restitution_threshold_m_s=chance.choice([0.0, 0.2, 3.0]),
            friction=chance.choice([0.0, 0.5, 2.0]),
            contact_erp=chance.choice([0.0, 0.2]),
            solver_residual=chance.choice([0.0, 1e-3]),
            solver_iterations=chance.choice([1, 50]),
            duration_s=0.7,
        )

    points = 0
    with LastingWorld(scenario()) as kept:
        for _ in range(25):
            following = scenario()
            assert kept.serves(following)
            kept.restart(following)
            mine, anew = (dropped_whole(one) for one in (kept, World(following)))
            points += len(mine.contacts)
            assert np.array_equal(mine.bases[BODY], anew.bases[BODY])
            assert np.array_equal(mine.contacts, anew.contacts)
    assert points > 1000


def test_a_world_is_not_kept_where_a_bit_might_differ() -> None:
    def serves(before: Scenario, after: Scenario) -> bool:
        with LastingWorld(before) as world:
            return world.serves(after)

    plain = Scenario(duration_s=0.1)
    assert serves(plain, replace(plain, height_m=3.0, linear_damping=0.1))
    assert not serves(replace(plain, linear_damping=0.1), plain)
    assert not serves(replace(plain, restitution=0.1), plain)
    assert not serves(plain, replace(plain, floor=False))
    assert not serves(plain, replace(plain, body="block.urdf"))
    assert not serves(replace(plain, body="r2d2.urdf"), replace(plain, body="r2d2.urdf"))
    maximal = replace(plain, coordinates="maximal")
    assert not serves(maximal, maximal)
    substeps = replace(plain, substeps=3)
    assert not serves(substeps, substeps)
    assert not serves(replace(plain, friction=0.1), plain)
    assert not serves(replace(plain, restitution_threshold_m_s=0.1), plain)


def test_a_sweep_leaves_no_world_behind(tmp_path: Path) -> None:
    """Calls of PyBullet without a client's number mean the first one that there is."""

    def connected() -> list[int]:
        return [client for client in range(64) if p.isConnected(client)]

    before = connected()
    sweep(plan_of({"height_m": "1,2"}), tmp_path / "s", record=False, jobs=1)
    assert connected() == before


def test_worlds_are_built_only_where_they_must_be() -> None:
    with Worlds() as worlds:
        first = worlds.world_of(Scenario())
        assert worlds.world_of(Scenario(height_m=2.0)) is first
        assert worlds.world_of(Scenario(floor=False)) is not first


# -- the same for any number of workers -----------------------------------------------------------


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> pl.DataFrame:
    """Return the rows of a sweep by one process."""
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
    parts = pl.scan_parquet(tmp_path / "parts" / "*.parquet").select(reference.columns)
    assert parts.collect().sort("run").equals(reference)
    assert reports[0] == (0, 0, 40)
    assert reports[-1] == (40, 0, 40)


@pytest.mark.long
@pytest.mark.needs("ray")
@pytest.mark.filterwarnings("ignore:.*:ResourceWarning", "ignore:.*:DeprecationWarning:ray")
@pytest.mark.filterwarnings("ignore:Tip. In future versions of Ray:FutureWarning")
def test_ray_gives_the_same_bits(tmp_path: Path, reference: pl.DataFrame) -> None:
    """A cluster of its own on loopback: head, scheduler and workers are processes."""
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
    """Ray itself would try for minutes."""
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
    """A worker's work, whose process is killed in the middle of one shard, but only once."""

    work: RunShard
    shard: int

    def __call__(self, shard: int) -> ShardDone:
        """Run the shard, or die of it."""
        flag = self.work.folder / "died"
        if shard == self.shard and not flag.exists():
            self.work.row(0)
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return self.work(shard)


@pytest.mark.long
def test_a_killed_workers_shard_is_run_again(tmp_path: Path) -> None:
    plan = plan_of({}, **HEIGHTS)
    (tmp_path / "parts").mkdir()
    work = DiesOnce(RunShard(plan, tmp_path, 0.3, False, None), 7)
    done = list(engines.in_processes(work, range(plan.shards), jobs=2))
    assert (tmp_path / "died").exists()
    assert sorted(shard for shard, _ in done) == list(range(40))
    parts = pl.scan_parquet(tmp_path / "parts" / "*.parquet").collect()
    assert parts["run"].sort().to_list() == list(range(40))


@pytest.fixture
def idle_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let workers not load what a sweep needs: here they do nothing of a sweep."""
    monkeypatch.setattr(engines, "_started", Worker)


@pytest.mark.usefixtures("idle_workers")
def test_workers_use_no_semaphore_that_outlives_a_kill(monkeypatch: pytest.MonkeyPatch) -> None:
    def semaphore(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr("multiprocessing.synchronize.SemLock.__init__", semaphore)
    assert sorted(engines.in_processes(double, range(3), jobs=2)) == [(0, 0), (1, 2), (2, 4)]
    with pytest.raises(OutputError, match="three"):
        list(engines.in_processes(double, range(4), jobs=2))


def test_too_few_open_files_for_our_libraries_are_one_line(
    drop_process: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found before one of them aborts."""

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
    """No matter where they are used up."""

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
    """A row would keep it for good."""

    def lacks(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(RunShard, "_fall", lacks)
        with pytest.raises(MemoryError):
            sweep(THREE, tmp_path, record=False, jobs=1)
    assert sweep(THREE, tmp_path, record=False, jobs=1).failed == 0


@pytest.mark.long
@pytest.mark.usefixtures("idle_workers")
def test_stopping_in_the_middle_waits_for_nobody() -> None:
    """However the workers and those who wait for them stand just then."""
    for _ in range(6):
        shards = engines.in_processes(nap, range(10_000), jobs=2)
        for _ in range(5):
            next(shards)
        closing = threading.Thread(target=shards.close, daemon=True)
        closing.start()
        closing.join(HANGS_S)
        assert not closing.is_alive()


@pytest.mark.usefixtures("idle_workers")
def test_who_wants_no_more_results_waits_for_no_shard() -> None:
    results = engines.in_processes(first_is_quick, range(100), jobs=2)
    assert next(results) == (0, 0)
    began = time.monotonic()
    results.close()
    assert time.monotonic() - began < 300, "it waits for the shards that are under way"


@pytest.mark.usefixtures("idle_workers")
def test_a_shard_that_kills_every_worker_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "MOST_DEATHS", 2)
    with pytest.raises(DropError, match="shard 0"):
        list(engines.in_processes(always_dies, range(1), jobs=1))


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
    finished = {path: path.stat().st_ino for path in (tmp_path / "parts").iterdir()}
    assert len(finished) == 10
    swept = sweep(plan, tmp_path, record=False, jobs=1)
    assert (swept.runs, swept.computed) == (40, 30)
    assert {path: path.stat().st_ino for path in finished} == finished
    assert swept.table().equals(reference)
    assert sweep(plan, tmp_path, record=False).computed == 0


@pytest.mark.parametrize(
    ("change", "differs"),
    [
        ({"samples": 41}, "samples"),
        ({"seed": 6}, "seed"),
        ({"vary": ["height=uniform:0.6:3"]}, "vary"),
        ({"given": {"linear_damping": "0"}}, "lists"),
        ({"at_s": 0.2}, "at_s"),
        ({"record": True}, "recorded"),
    ],
)
def test_another_sweep_is_turned_away(
    tmp_path: Path, change: dict[str, object], differs: str
) -> None:
    plan = {"given": {}, "samples": 3, "seed": 5, "vary": ["height=uniform:0.6:2"]}
    how = {"at_s": 0.3, "record": False}
    sweep(plan_of(**plan), tmp_path, **how)
    before = (tmp_path / "results.parquet").read_bytes()
    plan |= {key: value for key, value in change.items() if key in plan}
    how |= {key: value for key, value in change.items() if key in how}
    with pytest.raises(OutputError, match=differs):
        sweep(plan_of(**plan), tmp_path, **how)
    assert (tmp_path / "results.parquet").read_bytes() == before


@pytest.mark.long
def test_a_sweep_of_a_body_that_was_edited_is_another(tmp_path: Path) -> None:
    """Its URDF, or a mesh that it names."""
    folder, body = tmp_path / "s", tmp_path / "own.urdf"
    box = Path(pybullet_data.getDataPath(), "cube_small.urdf").read_text()
    body.write_text(box.replace("cube.obj", "own.obj"))
    mesh = Path(pybullet_data.getDataPath(), "cube.obj").read_text()
    (tmp_path / "own.obj").write_text(mesh)
    plan = plan_of({"body": str(body), "height_m": "1,2"})
    sweep(plan, folder, record=False)
    assert sweep(plan, folder, record=False).computed == 0
    (tmp_path / "own.obj").write_text(mesh + "# edited\n")
    with pytest.raises(OutputError, match="differs in bodies"):
        sweep(plan, folder, record=False)
    (tmp_path / "own.obj").write_text(mesh)
    body.write_text(body.read_text() + "\n")
    with pytest.raises(OutputError, match="differs in bodies"):
        sweep(plan, folder, record=False)


def test_recordings_that_were_there_before_are_not_replaced(tmp_path: Path) -> None:
    """`drop run` leaves them under such names, in a folder of that name."""
    theirs = tmp_path / "recordings" / "run-2.rrd"
    theirs.parent.mkdir()
    theirs.write_text("precious")
    with pytest.raises(OutputError, match="has results of something else"):
        sweep(plan_of({"height_m": "1,2,3"}), tmp_path)
    assert theirs.read_text() == "precious"


THREE = plan_of({"height_m": "1,2,3"})


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep in three parts."""
    folder = tmp_path_factory.mktemp("whole") / "s"
    sweep(THREE, folder, record=False)
    return folder


@pytest.fixture
def copied(whole: Path, tmp_path: Path) -> Path:
    """Return a copy of it."""
    return Path(shutil.copytree(whole, tmp_path / "s"))


def files_in(folder: Path) -> dict[str, bytes | None]:
    """Return all that there is, but for the lock: a file's content, None of anything else."""
    return {
        str(one.relative_to(folder)): one.read_bytes() if one.is_file() else None
        for one in folder.rglob("*")
        if one.name != ".lock"
    }


def test_a_part_can_be_moved_away_and_is_made_again(copied: Path, whole: Path) -> None:
    (copied / "parts" / "part-000001.parquet").unlink()
    assert sweep(THREE, copied, record=False).computed == 1
    assert files_in(copied) == files_in(whole)


NO_PARTS = {
    "another run's": lambda path: shutil.copy(path.with_name("part-000000.parquet"), path),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "no table": lambda path: path.write_bytes(b"no table"),
    "empty": lambda path: path.write_bytes(b""),
    "other columns": lambda path: pl.DataFrame({"run": [1]}).write_parquet(path),
    "nowhere": lambda path: (path.unlink(), path.symlink_to("nowhere")),
}


@pytest.mark.parametrize("alter", NO_PARTS.values(), ids=NO_PARTS)
def test_what_is_no_part_of_this_sweep_is_one_line(
    copied: Path, whole: Path, alter: Callable[[Path], object]
) -> None:
    part = copied / "parts" / "part-000001.parquet"
    alter(part)
    before = files_in(copied)
    with pytest.raises(OutputError, match=r"part-000001\.parquet does not hold runs of this sweep"):
        sweep(THREE, copied, record=False)
    assert files_in(copied) == before
    part.unlink()
    assert sweep(THREE, copied, record=False).computed == 1
    assert files_in(copied) == files_in(whole)


def test_parts_that_an_earlier_command_made_wait_until_they_are_needed(tmp_path: Path) -> None:
    plan = plan_of({"linear_damping": "0"}, samples=36, seed=1, vary=["gravity=normal:-9.81:1"])
    whole = sweep(plan, tmp_path, record=False, jobs=1).table()
    enough = sweep(plan, tmp_path, record=False, jobs=1, until_ci_m=1.0)
    assert (enough.runs, enough.computed) == (30, 0)
    assert enough.table().equals(whole.head(30))
    again = sweep(plan, tmp_path, record=False, jobs=1)
    assert (again.computed, again.table().equals(whole)) == (0, True)


def test_what_a_killed_worker_left_is_replaced(tmp_path: Path) -> None:
    sweep(THREE, tmp_path, jobs=1)
    path = tmp_path / "recordings" / "run-1.rrd"
    left, was = part_of(path), read(path).states
    left.write_bytes(path.read_bytes()[:-5000])
    (tmp_path / "parts" / "part-000001.parquet").unlink()
    assert sweep(THREE, tmp_path, jobs=1).computed == 1
    assert not left.exists()
    assert read(path).states.equals(was)


def test_a_recording_that_is_gone_is_made_again(tmp_path: Path) -> None:
    first = sweep(THREE, tmp_path)
    path = tmp_path / "recordings" / "run-1.rrd"
    was, rows = read(path).states, first.table()
    path.unlink()
    again = sweep(THREE, tmp_path)
    assert (again.computed, again.table().equals(rows)) == (1, True)
    assert read(path).states.equals(was)


def test_a_list_of_lists_of_lists_is_no_sweep(copied: Path) -> None:
    (copied / "sweep.json").write_text("[" * 100_000 + "]" * 100_000)
    with pytest.raises(OutputError, match=r"sweep\.json is damaged; choose another out"):
        sweep(THREE, copied, record=False)


def test_two_sweeps_at_a_time_do_not_share_a_folder(tmp_path: Path) -> None:
    plan = plan_of({}, **HEIGHTS)

    def meanwhile(done: int, _: int, __: int) -> None:
        if done == 3:
            with pytest.raises(OutputError, match="another sweep is running"):
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


def test_a_body_at_height_zero_is_swept(drop: Drop) -> None:
    how = ("--height", "0", "--no-floor", "--gravity", "zero", "--timestep", "1/240,1/480,1/960")
    done = drop("sweep", "--out", "s", "--no-record", "--json", *how)
    assert (done.returncode, done.stderr) == (0, "")
    (convergence,) = json.loads(done.stdout)["convergence"]
    assert convergence["study"]["relative_error"] is None


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
        (["--plot", "errors.png"], "two or more"),
        (["--plot", "errors.pdf"], ".png or .svg"),
        (["--until-ci", "1e-3"], "--samples"),
        (["--until-ci", "0", "--samples", "3", "--vary", "mass=uniform:1:2"], "above 0"),
        (["--until-ci", "1", "--samples", "3", "--vary", "mass=uniform:1:2"], "at least 30"),
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


def test_the_statistics_are_those_of_the_rows(tmp_path: Path) -> None:
    plan = plan_of({"linear_damping": "0,0.1"}, samples=30, seed=2, vary=["gravity=uniform:-10:-5"])
    swept = sweep(plan, tmp_path, record=False)
    undamped, damped = swept.statistics
    assert (undamped.label, damped.label) == ("linear damping 0", "linear damping 0.1")
    errors = swept.table().filter(pl.col("linear_damping") == 0.1)["error_m"].to_numpy()
    total = damped.statistics[0]
    assert (total.quantity, total.count) == ("error_m", 30)
    assert total.mean == pytest.approx(errors.mean(), rel=1e-12)
    assert total.spread == pytest.approx(errors.std(ddof=1), rel=1e-12)
    assert total.quantiles["5%"] == pytest.approx(np.quantile(errors, 0.05), rel=1e-12)
    # Without damping the error is g t dt/2: uniform like g, whose mean is -7.5.
    low, high = undamped.statistics[0].interval or (0.0, 0.0)
    assert low < -7.5 * 0.3 / 480 < high


@pytest.mark.long
def test_all_rows_of_the_statistics_are_of_the_same_samples(tmp_path: Path, drop: Drop) -> None:
    """Those in the air, whose terms add up; of those on the floor there is a total only."""
    how = ("--samples", "60", "--seed", "1", "--no-record", "--jobs", "1", "--json")
    done = drop("sweep", "--out", "s", *how, "--vary", "height=uniform:0.1:1")
    (group,) = json.loads(done.stdout)["statistics"]
    told = {one["quantity"]: one for one in group["summaries"]}
    rows = pl.read_parquet(tmp_path / "s" / "results.parquet")
    falling = rows.drop_nulls("timestep_m")
    assert 0 < len(falling) < len(rows)
    assert {one["count"] for one in told.values()} == {len(falling)}
    assert told["error_m"]["mean"] == pytest.approx(falling["error_m"].mean(), rel=1e-12)
    total = sum(told[term]["mean"] for term in TERMS[1:])
    assert total == pytest.approx(told["error_m"]["mean"], rel=1e-12)
    words = drop("sweep", "--out", "s", *how[:-1], "--vary", "height=uniform:0.1:1").stdout
    assert f"over the {len(falling)} of 60 samples in the air, in theory too" in words
    words = drop("sweep", "--out", "t", *how[:-1], "--vary", "height=uniform:0.1:0.2").stdout
    assert "over 60 samples; none was in the air, in theory too" in words
    assert "timestep" not in words


def test_sampling_stops_by_the_samples_that_the_statistics_are_of(tmp_path: Path) -> None:
    plan = plan_of({}, samples=400, seed=1, vary=["height=uniform:0.1:1"])
    swept = sweep(plan, tmp_path, record=False, jobs=1, until_ci_m=1e-9)
    low, high = swept.statistics[0].statistics[0].interval or (0.0, 1.0)
    # In the air the error is the same from any height, but for the rounding.
    assert swept.statistics[0].statistics[0].count >= 30
    assert swept.runs < 70
    assert swept.narrow_enough
    assert high - low <= 1e-9


def test_sampling_does_not_stop_at_equal_samples(tmp_path: Path) -> None:
    """One in a hundred samples differs, the first after 33."""
    values = ":".join(["0.04"] * 99 + ["0"])
    plan = plan_of({}, samples=600, seed=0, vary=[f"linear_damping=choice:{values}"])
    swept = sweep(plan, tmp_path, record=False, jobs=1, until_ci_m=1e-3)
    assert swept.table().head(30)["error_m"].n_unique() == 1
    assert swept.table()["error_m"].n_unique() == 2
    assert swept.narrow_enough


def test_equal_samples_are_narrow_enough_in_the_end(tmp_path: Path) -> None:
    plan = plan_of({}, samples=30, vary=["restitution=uniform:0:1"])
    swept = sweep(plan, tmp_path, record=False, jobs=1, until_ci_m=1e-3)
    assert (swept.runs, swept.narrow_enough) == (30, True)


@pytest.mark.long
def test_sampling_stops_when_the_interval_is_narrow_enough(tmp_path: Path) -> None:
    """Without damping the error is g t dt/2; g spreads by 1 m/s², the error by 0.625 mm."""
    plan = plan_of({"linear_damping": "0"}, samples=2000, seed=1, vary=["gravity=normal:-9.81:1"])
    width_m = 2.5e-4
    swept = sweep(plan, tmp_path / "one", record=False, jobs=1, until_ci_m=width_m)
    rows = swept.table()
    low, high = swept.statistics[0].statistics[0].interval or (0.0, 0.0)
    assert swept.narrow_enough
    assert high - low <= width_m
    assert 0 < swept.runs < 200
    assert swept.runs % plan.shard_runs == 0
    before = rows.head(swept.runs - plan.shard_runs)["error_m"].to_numpy()
    low, high = Moments().with_values(before).interval or (0.0, 1.0)
    assert high - low > width_m
    two = sweep(plan, tmp_path / "two", record=False, jobs=2, until_ci_m=width_m)
    assert two.table().equals(rows)
    # Another worker may have finished more parts by then; the table leaves them out.
    assert len(list((tmp_path / "two" / "parts").iterdir())) >= swept.runs // plan.shard_runs
    narrower = sweep(plan, tmp_path / "one", record=False, jobs=1, until_ci_m=width_m / 2)
    assert narrower.runs > swept.runs
    assert narrower.table().head(swept.runs).equals(rows)


# -- pictures -------------------------------------------------------------------------------------


def test_the_plot_shows_every_term_over_the_timestep() -> None:
    steps = np.array([1 / 240, 1 / 480, 1 / 960])
    errors = {
        "total": np.array([-1.8e-3, 1.2e-3, 2.8e-3]),
        "timestep": -1.4715 * steps,
        "damping": np.full(3, 4.3e-3),
        "interaction": np.array([7e-7, 5e-7, 3e-7]),
        "rounding": np.full(3, 3e-16),
    }
    figure = build_figure([Refinement("as it is", steps, errors, 1 / 341)], title="t", theme=LIGHT)
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    drawn = {line.get_label(): line for line in axes.get_lines()}
    for name in ("total", "timestep", "damping", "interaction"):
        assert np.array_equal(drawn[name].get_xdata(), steps)
        assert drawn[name].get_ydata() == pytest.approx(np.abs(errors[name]) * 1e3)
    texts = " ".join(text.get_text() for text in axes.texts)
    assert "rounding" in texts
    assert "1/341 s" in texts
    slope = drawn["_slope"]
    (x0, x1), (y0, y1) = slope.get_xdata(), slope.get_ydata()
    assert np.log(y1 / y0) / np.log(x1 / x0) == pytest.approx(1.0)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_a_plot_of_many_panels_is_no_wider(count: int) -> None:
    """Shown in a text of some width, its words would be the smaller the wider it is."""
    steps = 1 / (240 * 2.0 ** np.arange(8))
    terms = ("total", "timestep", "damping", "interaction", "rounding")
    errors = {name: 1e-3 * (1 + number) * steps for number, name in enumerate(terms)}
    panels = [Refinement(f"panel {number}", steps, errors, 1 / 341) for number in range(count)]
    figure = build_figure(panels, title="t", theme=LIGHT)
    assert figure.get_figwidth() == 8
    assert len(figure.axes) == min(count, 4)
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.get_xlabel() == "timestep [s]"
        ticks = [one.get_window_extent() for one in axes.get_xticklabels()]
        assert len(ticks) > 2
        assert all(left.x1 < right.x0 for left, right in pairwise(ticks))
        for text in axes.texts:
            assert text.get_window_extent().x1 <= figure.bbox.x1


# -- a person at the terminal ---------------------------------------------------------------------


@pytest.fixture
def long_sweep(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Return a sweep by two processes that takes minutes."""
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
        ],  # in parts of 313
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
    )
    parts = tmp_path / "s/parts"
    wait_for(lambda: len([*parts.glob("*.parquet")]) > 1 or process.poll() is not None, "no parts")
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
    done = len([*tmp_path.glob("s/parts/*.parquet")])
    long_sweep.send_signal(signal.SIGINT)
    stdout, stderr = long_sweep.communicate(timeout=HANGS_S)
    # Nothing is begun after that; what the two are at may just be done.
    assert len([*tmp_path.glob("s/parts/*.parquet")]) <= done + 2
    assert (long_sweep.returncode, stdout, len(stderr.splitlines())) == (130, "", 1)
    assert "of 20,000 runs done in s; run the same command again to resume" in stderr
    assert not list(tmp_path.glob("s/parts/*.part"))
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


def test_nothing_is_asked_of_an_impossible_combination() -> None:
    with pytest.raises(ScenarioError, match="one scenario"):
        sweep(
            plan_of({"height_m": "1,2"}, samples=3, vary=["mass=uniform:1:2"]),
            "unused",
            until_ci_m=1.0,
        )

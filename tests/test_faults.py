"""Fault tolerance: whatever happens while a recording is written, no existing file is lost.

After each fault an existing recording is untouched or replaced whole, the `.part` holds every
complete chunk that was written and can be analyzed, one line says what happened, the exit code is
right, nothing hangs, and no process is left behind. By hand, with more runs that are killed:

    python tests/test_faults.py 50 SEED
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import rerun.blueprint as rrb
from command import HANGS_S, drop_here, environment, run_here, wait_for
from conftest import Drop, descendants_of, some
from drop_physics import Scenario, analyze, check, render, simulate
from drop_physics.errors import OutputError, RecordingError, ScenarioError
from drop_physics.files.outputs import MOST_PARTS, check_room, output_errors, part_of, sealed_of
from drop_physics.files.whole import opened
from drop_physics.recording import sealing
from drop_physics.recording.layer_file import layer_of
from drop_physics.recording.reader import Recording, read
from drop_physics.scenario import BYTES_PER_SAMPLE
from drop_physics.stages import run as run_stage
from drop_physics.stages.record import record_script
from drop_physics.stages.simulate.recorded import BATCH
from drop_physics.stages.sweep import sweep
from drop_physics.sweeping.plan import plan_of
from drop_physics.temporary import temporary_folder
from drop_physics.workers import cores
from PIL import Image
from rerun.chunk import LazyChunkStream

pytestmark = pytest.mark.pybullet

KILLS = 9
"""Number of runs to kill at various moments: with each signal, while stepping and while sealing."""
SEED = 6
ONE_BATCH = BATCH * BYTES_PER_SAMPLE
"""Maximum number of bytes written at once."""
LONG = ("simulate", "--out", "run.rrd", "--no-camera", "--force", "--duration", "5000")
SHORT = ("simulate", "--out", "run.rrd", "--no-camera", "--force", "--duration", "20")
TINY = ("simulate", "--out", "run.rrd", "--no-camera", "--force", "--duration", "0.05")
FULL = ("simulate", "--out", "run.rrd", "--force")


def start(arguments: tuple[str, ...], folder: Path, **how: object) -> subprocess.Popen[str]:
    """Start the command in a new session, so that all its processes can be counted."""
    return subprocess.Popen(
        [sys.executable, "-m", "drop_physics", *arguments],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **how,  # type: ignore[call-overload]
    )


def outcome(arguments: tuple[str, ...], folder: Path) -> tuple[int, str, str]:
    """Run the command in this process; return its exit code and its output."""
    done = drop_here(*arguments, folder=folder)
    return done.returncode, done.stdout, done.stderr


def ended(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Return a process's output, once it and all its descendants have ended."""
    try:
        output = process.communicate(timeout=HANGS_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    wait_for(lambda: not is_alive(process.pid), "a process was left behind")
    return output


def is_alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def size(path: Path, missing: int = 0) -> int:
    return path.stat().st_size if path.exists() else missing


def assert_one_line(stdout: str, stderr: str, *words: str) -> None:
    assert stdout == ""
    assert len(stderr.splitlines()) == 1, stderr
    assert stderr.startswith("drop: ")
    for word in words:
        assert word in stderr


def salvaged(part: Path) -> Recording | None:
    """Read a `.part`; return None if it was stopped before its first complete sample."""
    if size(part) < 2 * ONE_BATCH:
        with contextlib.suppress(RecordingError):
            return read(part)
        return None
    return read(part)


@pytest.fixture(scope="module")
def precious(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the content of an already existing recording."""
    path = tmp_path_factory.mktemp("precious") / "run.rrd"
    simulate(Scenario(duration_s=0.1), path, camera=None)
    return path.read_bytes()


# -- the disk -------------------------------------------------------------------------------------


@contextlib.contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[None]:
    """Mount a small disk on a folder; if that is not permitted, limit the file size instead.

    The limit is that of this process and of those it starts.
    """
    options = f"size={kilobytes}k"
    mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    if os.geteuid() == 0 and subprocess.run(mount, capture_output=True).returncode == 0:
        try:
            yield
        finally:
            subprocess.run(["umount", "-l", str(folder)], check=True)
        return
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (kilobytes * 1024, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    ("arguments", "room_kb", "samples"),
    some(
        [
            (TINY, 16, 0),  # among the properties and the scene
            (TINY, 40, 13),  # in the footer
            (TINY, 110, 13),  # while it is sealed
            (FULL, 300, 241),  # among the frames
            (FULL, 500, 241),  # while it is sealed
        ],
        1,
    ),
)
def test_a_full_disk_costs_neither_the_old_recording_nor_the_samples_that_fitted(
    tmp_path: Path, precious: bytes, arguments: tuple[str, ...], room_kb: int, samples: int
) -> None:
    disk, old_kb = tmp_path / "disk", len(precious) // 1024 + 4
    disk.mkdir()
    with small_disk(disk, old_kb + room_kb):
        (disk / "run.rrd").write_bytes(precious)
        code, *output = outcome(arguments, disk)
        assert code == 1
        assert_one_line(*output, "run.rrd", "make room")
        assert (disk / "run.rrd").read_bytes() == precious
        part = disk / "run.rrd.part"
        assert part.exists() == ("run.rrd.part" in output[1]) == (samples > 0)
        assert {file.name for file in disk.iterdir()} - {part.name} == {"run.rrd"}
        if samples:
            salvage = salvaged(part)
            assert salvage is not None
            assert len(salvage.states) == samples
            assert analyze(part, out=tmp_path / "layer.rrd").airborne.samples > 0


@pytest.mark.parametrize(("arguments", "room_kb"), [(TINY, 8), (FULL, 200)])
def test_nothing_is_written_to_a_disk_that_is_too_small_from_the_start(
    tmp_path: Path,
    precious: bytes,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    room_kb: int,
) -> None:
    whole = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: whole._replace(free=1024 * room_kb))
    (tmp_path / "run.rrd").write_bytes(precious)
    code, *output = outcome(arguments, tmp_path)
    assert code == 1
    assert_one_line(*output, "run.rrd needs about", "kB are free")
    assert (tmp_path / "run.rrd").read_bytes() == precious
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("analyze", "run.rrd"),
        *(
            pytest.param(each, marks=pytest.mark.long)
            for each in (
                ("analyze", "run.rrd", "--out", "../layer.rrd", "--table", "run.csv"),
                ("analyze", "run.rrd", "--out", "../layer.rrd", "--table", "run.parquet"),
                ("render", "run.rrd"),
                ("check", "run.rrd", "--against", "golden.rrd", "--update"),
            )
        ),
    ],
    ids=lambda arguments: arguments[-1],
)
def test_a_full_disk_leaves_no_other_file_half_written(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    simulate(Scenario(), tmp_path / "run.rrd", camera=None)
    data = (tmp_path / "run.rrd").read_bytes()
    with small_disk(disk, len(data) // 1024 + 12):
        (disk / "run.rrd").write_bytes(data)
        code, *output = outcome(arguments, disk)
        assert code == 1, output
        assert_one_line(*output, "cannot be written")
        assert (disk / "run.rrd").read_bytes() == data
        assert [file.name for file in disk.iterdir()] == ["run.rrd"]
        assert "what was recorded" not in output[1]


def test_a_full_disk_names_the_file_written_and_not_its_source(
    tmp_path: Path,
) -> None:
    disk, script = tmp_path / "disk", tmp_path / "script.py"
    disk.mkdir()
    script.write_text("import pybullet as p\np.connect(p.DIRECT)\np.stepSimulation()\n")
    record_script(str(script), out=tmp_path / "run.rrd")
    with small_disk(disk, 12):
        code, *output = outcome(
            ("check", "../run.rrd", "--against", "golden.rrd", "--update"), disk
        )
        assert code == 1, output
        assert_one_line(*output, "drop: golden.rrd.part cannot be written")
        assert not list(disk.iterdir())


def test_a_rename_that_fails_names_the_final_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match=r"^b cannot be written: "), output_errors(Path("c")):
        Path("a").rename("b")


def test_a_layout_that_cannot_be_stored_temporarily_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise RuntimeError("No space left on device (os error 28)")

    monkeypatch.setattr(rrb.Blueprint, "save", full)
    with pytest.raises(OutputError, match=r"layout\.rbl cannot be written: No space left on dev"):
        simulate(Scenario(), tmp_path / "run.rrd", camera=None)


@pytest.mark.parametrize("room_kb", some([12, 60, 150], 1))
def test_a_full_disk_in_a_sweep_is_one_line(tmp_path: Path, room_kb: int) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    arguments = ("--samples", "200", "--vary", "height=uniform:1:2", "--no-record", "--jobs", "1")
    with small_disk(disk, room_kb):
        code, *output = outcome(("sweep", "--out", "s", *arguments), disk)
        assert code == 1
        assert_one_line(*output, " cannot be written: ")
        assert "No space left" in output[1] or "File too large" in output[1]
        assert not list(disk.rglob("*.part"))


@pytest.mark.long
def test_a_sweep_whose_recordings_cannot_fit_is_not_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ("--samples", "100000", "--vary", "height=uniform:1:2")
    monkeypatch.setattr("drop_physics.stages.sweep.LEAST_BYTES", 50_000_000_000)
    code, *output = outcome(("sweep", "--out", "s", *arguments), tmp_path)
    assert code == 1
    assert_one_line(*output, "s needs about 5.0 PB", "record less")
    assert not list(tmp_path.rglob("*.rrd*"))


def test_too_little_room_is_reported_before_the_work_starts(tmp_path: Path) -> None:
    free = shutil.disk_usage(tmp_path).free
    with pytest.raises(OutputError, match=r"B .*free"):
        check_room(tmp_path / "run.rrd", free * 2)
    steps = min(1_000_000_000, free // 200)
    with pytest.raises(OutputError, match="GB on the disk"):
        simulate(
            Scenario(timestep_s=1e-3, duration_s=steps / 1000), tmp_path / "x.rrd", camera=None
        )
    assert list(tmp_path.iterdir()) == []


def test_what_a_large_recording_takes_is_reported_before_the_work_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drop_physics.stages.simulate.LARGE_BYTES", 1000)
    notes: list[str] = []
    simulate(Scenario(), tmp_path / "run.rrd", camera=None, note=notes.append)
    assert len(notes) == 1
    assert "241 samples take about" in notes[0]


# -- the folder -----------------------------------------------------------------------------------


def test_a_folder_that_is_read_only_gets_one_line_and_nothing_new(
    tmp_path: Path, precious: bytes
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    with contextlib.ExitStack() as stack:
        stack.enter_context(small_disk(disk, 1000))
        (disk / "run.rrd").write_bytes(precious)
        if os.path.ismount(disk):  # root may write anywhere but on a disk that is read-only
            subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        else:
            disk.chmod(0o555)
            stack.callback(disk.chmod, 0o755)
        for arguments in (
            TINY,
            ("render", "run.rrd"),
            ("check", "run.rrd", "--against", "golden.rrd", "--update"),
        ):
            code, *output = outcome(arguments, disk)
            assert code == 1
            assert_one_line(*output, "cannot be written")
        code, *_ = outcome(("analyze", "run.rrd"), disk)  # shown, without a layer
        assert code == 0
        assert [file.name for file in disk.iterdir()] == ["run.rrd"]


@pytest.mark.long
def test_a_folder_that_vanishes_gets_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    process = start((*SHORT[:2], str(folder / "run.rrd"), *SHORT[3:]), tmp_path)
    wait_for(lambda: size(folder / "run.rrd.part") > 0, "no .part")
    shutil.rmtree(folder)
    output = ended(process)
    assert process.returncode == 1
    assert_one_line(*output, "No such file")
    assert not folder.exists()


def test_targets_that_are_not_files_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a file").write_text("precious")
    os.mkfifo(tmp_path / "pipe.rrd")
    for target, words in (
        (tmp_path, "is a folder"),
        (tmp_path / "a file" / "run.rrd", "is a file, not a folder"),
        (tmp_path / "pipe.rrd", "not a regular file"),
        (tmp_path / ("x" * 300 + ".rrd"), "too long"),
    ):
        code, *output = outcome(("simulate", "--out", str(target), "--force"), tmp_path)
        assert_one_line(*output, words)
        assert code == 1
    assert {file.name for file in tmp_path.iterdir()} == {"a file", "pipe.rrd"}
    assert (tmp_path / "a file").read_text() == "precious"


# -- names that mean one file ---------------------------------------------------------------------


def named(kind: str, folder: Path, target: Path, suffix: str) -> Path:
    """Return a path for a file: the file itself, a symbolic link, or a hard link."""
    path = folder / f"other{suffix}"
    if kind == "symbolic link":
        path.symlink_to(target)
    elif kind == "hard link":
        path.hardlink_to(target)
    elif kind == "another path":
        (folder / "sub").mkdir()
        path = folder / "sub" / ".." / target.name
    else:
        path = target
    return path


@pytest.fixture
def run_rrd(tmp_path: Path, precious: bytes) -> Path:
    """Return a recording in a folder of its own."""
    path = tmp_path / "run.rrd"
    path.write_bytes(precious)
    return path


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording with frames."""
    path = tmp_path_factory.mktemp("filmed") / "run.rrd"
    simulate(Scenario(duration_s=0.1), path)
    return path


@pytest.mark.parametrize("kind", ["its name", "another path", "symbolic link", "hard link"])
def test_a_layer_does_not_replace_its_recording(run_rrd: Path, precious: bytes, kind: str) -> None:
    out = named(kind, run_rrd.parent, run_rrd, ".rrd")
    with pytest.raises(OutputError, match="which the same command reads"):
        analyze(run_rrd, out=out, force=True)
    assert run_rrd.read_bytes() == precious


@pytest.mark.parametrize("kind", ["symbolic link", "hard link"])
def test_no_other_output_replaces_the_recording(run_rrd: Path, precious: bytes, kind: str) -> None:
    for suffix, write in (
        (".csv", lambda path: analyze(run_rrd, table=path, force=True)),
        (".webp", lambda path: render(run_rrd, out=path, force=True)),
        (".svg", lambda path: render(run_rrd, plot=path, force=True)),
    ):
        path = named(kind, run_rrd.parent, run_rrd, suffix)
        with pytest.raises(OutputError, match="which the same command reads"):
            write(path)
        path.unlink()
    with pytest.raises(OutputError, match="which the same command reads"):
        check(run_rrd, named(kind, run_rrd.parent, run_rrd, ".rrd"), update=True)
    assert run_rrd.read_bytes() == precious


def test_two_outputs_are_not_one_file(run_rrd: Path) -> None:
    layer, table = run_rrd.with_name("layer.rrd"), run_rrd.with_name("table.csv")
    table.symlink_to(layer)
    with pytest.raises(OutputError, match="which the same command writes"):
        analyze(run_rrd, out=layer, table=table, force=True)


def test_a_body_is_not_replaced_by_its_recording(tmp_path: Path) -> None:
    body = tmp_path / "body.rrd"
    body.write_text(
        '<robot name="box"><link name="base"><inertial><mass value="1"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        '<collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>'
    )
    written = body.read_bytes()
    with pytest.raises(OutputError, match="which the same command reads"):
        simulate(Scenario(body=str(body)), body, camera=None, force=True)
    assert body.read_bytes() == written


def test_the_part_that_is_read_is_not_written_over(run_rrd: Path, precious: bytes) -> None:
    """`RUN.rrd` is written as `RUN.rrd.part`, a name that is taken if that is the input."""
    part = run_rrd.rename(run_rrd.with_name("run.rrd.part"))
    with pytest.raises(OutputError, match=r"run\.rrd\.part, which the same command reads"):
        analyze(part, out=run_rrd)
    assert part.read_bytes() == precious


@pytest.mark.parametrize("name", ["a.png", "b.gif"])
def test_a_recording_named_like_a_picture_is_not_overwritten(
    run_rrd: Path, precious: bytes, name: str
) -> None:
    path = run_rrd.rename(run_rrd.with_name(name))
    with pytest.raises(OutputError, match="which the same command reads"):
        render(path)
    assert path.read_bytes() == precious


@pytest.mark.parametrize("name", ["s.png", "s", "s.RRD", ".rrd", "s.rrd.part"])
def test_a_recording_ends_in_rrd(run_rrd: Path, name: str) -> None:
    path = run_rrd.with_name(name)
    for write in (
        lambda: simulate(Scenario(), path, camera=None),
        lambda: analyze(run_rrd, out=path),
        lambda: check(run_rrd, path, update=True),
    ):
        with pytest.raises(ScenarioError, match=r"must end in \.rrd, got"):
            write()
    assert not path.exists()


def test_only_a_layer_is_replaced_under_a_layers_default_name(
    run_rrd: Path, precious: bytes
) -> None:
    layer = run_rrd.with_name("run.analysis.rrd")
    analyze(run_rrd)
    old = layer.stat().st_ino
    analyze(run_rrd)
    assert layer.stat().st_ino != old
    for other in (precious, b"text", b""):
        layer.write_bytes(other)
        with pytest.raises(OutputError, match=r"run\.analysis\.rrd is not what drop writes"):
            analyze(run_rrd)
        assert layer.read_bytes() == other
    both = sealing.binary(), "rrd", "merge", layer.with_name("x.rrd"), run_rrd, "-o", layer
    analyze(run_rrd, out=layer.with_name("x.rrd"))
    subprocess.run(both, check=True, capture_output=True)  # a layer, and more
    with pytest.raises(OutputError, match="is not what drop writes"):
        analyze(run_rrd)
    analyze(run_rrd, force=True)


@pytest.mark.long
def test_only_pictures_are_replaced_under_their_default_names(
    run_rrd: Path, precious: bytes
) -> None:
    """Only images made by drop are replaced: a user's own video may have the same name."""
    film = io.BytesIO()
    Image.new("RGB", (8, 8), "red").save(film, "gif")
    plot = io.BytesIO()
    Image.new("RGB", (8, 8), "red").save(plot, "png")
    for name, own in (("run.gif", film), ("run.png", plot)):
        path = run_rrd.with_name(name)
        for theirs in (precious, own.getvalue()):
            path.write_bytes(theirs)
            with pytest.raises(OutputError, match="is not what drop writes"):
                render(run_rrd)
            assert path.read_bytes() == theirs
        path.unlink()
    render(run_rrd)
    render(run_rrd)


def test_what_a_killed_analysis_left_is_written_over(run_rrd: Path, drop: Drop) -> None:
    """A layer is recomputed from its recording, so that an unfinished one is of no value."""
    layer = layer_of(run_rrd)
    left = [part_of(layer), sealed_of(part_of(layer))]
    for each in left:
        each.write_bytes(b"unfinished")
    done = drop("analyze", run_rrd)
    assert done.returncode == 0, done.stderr
    assert layer.exists()
    assert not any(each.exists() for each in left)


def test_a_part_that_is_a_link_is_not_followed(run_rrd: Path, precious: bytes) -> None:
    """A named pipe does not make it wait either."""
    part = run_rrd.with_name("new.rrd.part")
    for make in (lambda: part.symlink_to(run_rrd), lambda: os.mkfifo(part), part.mkdir):
        make()
        with pytest.raises(OutputError, match=r"new\.rrd\.part is in the way and is not a regular"):
            simulate(Scenario(duration_s=0.1), part.with_suffix(""), camera=None)
        with pytest.raises(OutputError, match=r"new\.rrd\.part is in the way and is not a regular"):
            opened(part)
        part.rmdir() if part.is_dir() and not part.is_symlink() else part.unlink()
    sealed = run_rrd.with_name("new.rrd.part.sealed")
    sealed.symlink_to(run_rrd)
    with pytest.raises(OutputError, match=r"new\.rrd\.part\.sealed is in the way"):
        simulate(Scenario(duration_s=0.1), part.with_suffix(""), camera=None)
    assert sealed.is_symlink()
    assert not part.exists()
    simulate(Scenario(duration_s=0.1), part.with_suffix(""), camera=None, force=True)
    assert not sealed.is_symlink()
    assert run_rrd.read_bytes() == precious


def record_one_step(folder: Path, out: Path, *, force: bool) -> None:
    script = folder / "script.py"
    script.write_text("import pybullet as p\np.connect(p.DIRECT)\np.stepSimulation()\n")
    record_script(str(script), out=out, force=force)


WRITERS: dict[str, Callable[[Path, Path, bool], object]] = {
    "new.rrd": lambda _, out, force: simulate(
        Scenario(duration_s=0.1), out, camera=None, force=force
    ),
    "run.analysis.rrd": lambda run, _, force: analyze(run, force=force),
    "layer.rrd": lambda run, out, force: analyze(run, out=out, force=force),
    "t.csv": lambda run, out, force: analyze(run, table=out, force=force),
    "t.parquet": lambda run, out, force: analyze(run, table=out, force=force),
    "run.gif": lambda run, _, force: render(run, force=force),
    "run.png": lambda run, _, force: render(run, force=force),
    "a.webp": lambda run, out, force: render(run, out=out, force=force),
    "p.svg": lambda run, out, force: render(run, plot=out, force=force),
    "script.rrd": lambda run, out, force: record_one_step(run.parent, out, force=force),
    "golden.rrd": lambda run, out, _: check(run, out, update=True),
}
"""How each file is written from a recording `run.rrd` with frames, keyed by the file's name."""


@pytest.mark.parametrize("name", some([name for name in WRITERS if name != "run.analysis.rrd"], 1))
def test_an_existing_part_is_kept(tmp_path: Path, filmed: Path, name: str) -> None:
    """The `.part` may be anything, complete or unfinished; with --force it is replaced.

    That of a layer is nobody's: `test_what_a_killed_analysis_left_is_written_over`.
    """
    run, out = tmp_path / "run.rrd", tmp_path / name
    run.write_bytes(filmed.read_bytes())
    part = part_of(out)
    part.write_bytes(b"precious")
    inode = part.stat().st_ino
    WRITERS[name](run, out, False)
    assert out.stat().st_size > 0
    assert (part.read_bytes(), part.stat().st_ino) == (b"precious", inode)
    assert list(tmp_path.rglob("*.part")) == [part]
    if name != "golden.rrd":  # drop check has no --force
        WRITERS[name](run, out, True)
        assert list(tmp_path.rglob("*.part*")) == []


def stop(*_: object) -> None:
    """Interrupt a run from its progress callback, as Ctrl-C does."""
    raise KeyboardInterrupt


def test_a_run_that_was_stopped_can_be_repeated_and_what_it_left_stays(tmp_path: Path) -> None:
    """When there are too many such files, an error in one line says so."""
    run, notes = tmp_path / "run.rrd", list[str]()
    left: dict[Path, bytes] = {}
    for number in range(1, MOST_PARTS + 1):
        part = tmp_path / (f"run.rrd.{number}.part" if number > 1 else "run.rrd.part")
        with pytest.raises(KeyboardInterrupt) as raised:
            simulate(Scenario(duration_s=0.1), run, camera=None, progress=stop, note=notes.append)
        assert raised.value.__notes__ == [f"what had been recorded is in {part}"]
        assert len(notes) == number - 1
        assert not notes or f"this recording grows as {part}" in notes[-1]
        left[part] = part.read_bytes()
    with pytest.raises(OutputError, match=r"run\.rrd\.part and 8 more unfinished files"):
        simulate(Scenario(duration_s=0.1), run, camera=None)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == left
    part.unlink()
    simulate(Scenario(duration_s=0.1), run, camera=None)
    assert not read(run).partial
    del left[part]
    assert {file: file.read_bytes() for file in tmp_path.iterdir() if file != run} == left


def test_with_force_a_stopped_run_leaves_one_part_however_often(tmp_path: Path) -> None:
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            simulate(
                Scenario(duration_s=0.1),
                tmp_path / "run.rrd",
                camera=None,
                force=True,
                progress=stop,
            )
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd.part"]


def test_a_second_writer_is_rejected_beside_an_existing_part_too(tmp_path: Path) -> None:
    run = tmp_path / "run.rrd"
    part_of(run).write_bytes(b"precious")
    with sealing.unfinished(run, force=False) as part:
        assert part.name == "run.rrd.2.part"
        for force in (False, True):
            with pytest.raises(OutputError, match="another process is writing"):
                simulate(Scenario(duration_s=0.1), run, camera=None, force=force)
        part.write_bytes(b"mine")
        part.rename(run)
    assert part_of(run).read_bytes() == b"precious"
    assert run.read_bytes() == b"mine"


def test_a_forced_part_holds_only_this_run(tmp_path: Path) -> None:
    """A run that fails before writing anything does not claim that the part contains data."""
    run = tmp_path / "run.rrd"
    with pytest.raises(KeyboardInterrupt):
        simulate(Scenario(duration_s=0.1), run, camera=None, progress=stop)
    with pytest.raises(KeyboardInterrupt) as raised, sealing.unfinished(run, force=True):
        raise KeyboardInterrupt
    assert not getattr(raised.value, "__notes__", [])
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_recording_is_read_under_a_name_that_is_free(
    run_rrd: Path, precious: bytes
) -> None:
    """The advice on reading a truncated recording does not suggest replacing an existing file."""
    part_of(run_rrd).write_bytes(b"theirs")
    run_rrd.write_bytes(precious[:-2000])
    with pytest.raises(RecordingError) as raised:
        read(run_rrd)
    assert f"mv {run_rrd} {run_rrd}.2.part" in str(raised.value)


def test_a_part_that_is_also_a_whole_recording_is_not_written_into(
    run_rrd: Path, precious: bytes
) -> None:
    """A run is killed after its recording has its final name, but before the `.part` is removed."""
    part = part_of(run_rrd)
    part.hardlink_to(run_rrd)
    with sealing.unfinished(run_rrd, force=True):
        part.write_bytes(b"begun")
    assert run_rrd.read_bytes() == precious


def test_a_link_that_leads_nowhere_is_a_file_that_exists(run_rrd: Path) -> None:
    link = run_rrd.with_name("link.rrd")
    link.symlink_to(run_rrd.with_name("nowhere"))
    with pytest.raises(OutputError, match=r"link\.rrd exists and is left as it is"):
        simulate(Scenario(duration_s=0.1), link, camera=None)
    simulate(Scenario(duration_s=0.1), link, camera=None, force=True)
    assert not link.is_symlink()
    assert not run_rrd.with_name("nowhere").exists()


def test_a_recording_created_by_another_process_is_kept(run_rrd: Path) -> None:
    """The error message describes the files correctly, too."""
    new = run_rrd.with_name("new.rrd")

    def create(*_: object) -> None:
        new.write_text("theirs")

    with pytest.raises(OutputError, match="created by another process") as raised:
        simulate(Scenario(duration_s=0.1), new, camera=None, progress=create)
    assert new.read_text() == "theirs"
    assert raised.value.__notes__ == [f"what had been recorded is in {new}.part"]
    assert not read(new.with_name("new.rrd.part")).partial
    output = str(raised.value).split()
    assert not [word for word in output if "new.rrd." in word]  # no file that is gone


def test_a_recording_that_does_not_verify_is_not_reported_as_kept(
    run_rrd: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = sealing._rerun

    def damaging(*arguments: str | Path, **how: Any) -> str:
        printed = real(*arguments, **how)
        how["stdout"].seek(how["stdout"].tell() // 4)
        how["stdout"].write(bytes(64))
        how["stdout"].flush()
        return printed

    monkeypatch.setattr(sealing, "_rerun", damaging)
    new = run_rrd.with_name("new.rrd")
    with pytest.raises(OutputError, match="does not verify") as raised:
        simulate(Scenario(duration_s=0.1), new, camera=None)
    assert {file.name for file in new.parent.iterdir()} == {"run.rrd", "new.rrd.part"}
    assert "sealed" not in str(raised.value)
    assert raised.value.__notes__ == [f"what had been recorded is in {new}.part"]


def test_where_rerun_gets_no_memory_the_file_is_not_said_to_be_wrong(
    run_rrd: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With `ulimit -v 1300000` Rerun says that it has no memory, and exits with 102."""
    rerun = run_rrd.with_name("rerun")
    text = "thread 'main' panicked at 'OS can't spawn worker thread'"
    rerun.write_text(f'#!/bin/sh\necho "{text}" >&2\nexit 102\n')
    rerun.chmod(0o755)
    monkeypatch.setattr(sealing, "binary", lambda: str(rerun))
    with pytest.raises(
        OutputError, match=r"rerun rrd route has failed \(OS can't spawn worker thread\); is there"
    ):
        simulate(Scenario(duration_s=0.1), run_rrd.with_name("new.rrd"), camera=None)


def test_no_file_that_goes_with_its_folder_is_said_to_be_kept() -> None:
    with temporary_folder() as folder:
        new = folder / "new.rrd"
        with pytest.raises(OutputError, match="created by another process") as raised:
            simulate(
                Scenario(duration_s=0.1),
                new,
                camera=None,
                progress=lambda *_: new.write_text("theirs"),
            )
        assert not getattr(raised.value, "__notes__", [])


@pytest.mark.long
def test_runs_at_once_in_one_folder_are_numbered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each run waits after choosing its number, until all have chosen one."""
    all_chosen = threading.Barrier(2)
    real = run_stage.Worker

    def waiting() -> object:
        all_chosen.wait(HANGS_S)
        return real()

    monkeypatch.setattr(run_stage, "Worker", waiting)

    def run_one(_: int) -> str:
        whole = run_stage.run(Scenario(duration_s=0.1), tmp_path / "d", camera=None)
        return whole.simulation.recording.name

    with ThreadPoolExecutor(2) as pool:
        names = sorted(pool.map(run_one, range(2)))
    assert names == ["run-2.rrd", "run.rrd"]
    assert len(list((tmp_path / "d").iterdir())) == 2 * 3  # recording, layer, plot


def test_a_run_that_fails_frees_its_number(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError):
        run_stage.run(Scenario(body="gone.urdf"), tmp_path / "d", camera=None)
    assert list((tmp_path / "d").iterdir()) == []


# -- signals --------------------------------------------------------------------------------------


def killed(folder: Path, number: int, seed: int, precious: bytes) -> tuple[int, str, str]:
    """Kill one run at its chosen moment; return its exit code and output.

    Two of three are killed while stepping, the others around the time of sealing.
    """
    chance = random.Random(seed * 1000 + number)
    how = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)[number % 3]
    folder.mkdir()
    (folder / "run.rrd").write_bytes(precious)
    long = number // 3 % 3 != 2
    process = start(LONG if long else SHORT, folder)
    # Timed by what it has written, so that the machine's speed does not matter.
    least = chance.uniform(0, 3 * ONE_BATCH) if long else 0
    wait_for(lambda: size(folder / "run.rrd.part", missing=-1) >= least, "no .part")
    time.sleep(chance.uniform(0, 0.1 if long else 0.6))
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(how)
    stdout, stderr = ended(process)
    expected = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}[how]
    whole = (folder / "run.rrd").read_bytes() != precious
    assert process.returncode == expected or (process.returncode == 0 and whole)
    return process.returncode, stdout, stderr


def hold_many(kills: int, seed: int, place: Path, precious: bytes) -> None:
    """Kill a number of runs, and check the files that each leaves."""
    folders = [place / str(number) for number in range(kills)]
    given = folders, range(kills), [seed] * kills, [precious] * kills
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(killed, *given, timeout=kills * HANGS_S))
    parts, salvaged_after = [], set()
    for folder, (code, stdout, stderr) in zip(folders, results, strict=True):
        if (folder / "run.rrd").read_bytes() != precious:
            assert not read(folder / "run.rrd").partial
        part = folder / "run.rrd.part"
        if part.exists() and (salvage := salvaged(part)) is not None:
            parts.append(salvage)
            salvaged_after.add(code)
        if code in (130, 143):
            assert_one_line(stdout, stderr, "interrupted" if code == 130 else "terminated")
            assert ("run.rrd.part" in stderr) == (part.exists() and size(part) > 0)
        # A killed process cannot remove the copy being sealed; nothing else may be left.
        known = {"run.rrd", "run.rrd.part", "run.rrd.part.sealed"}
        assert {file.name for file in folder.iterdir()} <= known
        assert code == -9 or not (folder / "run.rrd.part.sealed").exists()
    assert len(parts) >= kills / 4
    assert salvaged_after >= {130, 143, -9}
    # The scenario is deterministic: every part is a beginning of the longest.
    longest = max((salvage.states for salvage in parts), key=len)
    for salvage in parts:
        assert salvage.states.equals(longest.head(len(salvage.states)))
        assert salvage.partial or len(salvage.states) == salvage.scenario.steps + 1
    assert len(longest) > 10_000


@pytest.mark.long
def test_a_run_killed_at_any_moment_loses_no_existing_file(tmp_path: Path, precious: bytes) -> None:
    hold_many(KILLS, SEED, tmp_path, precious)


@pytest.mark.long
def test_a_sweep_that_is_killed_repeatedly_resumes_from_its_own_files(
    tmp_path: Path, drop: Drop
) -> None:
    """It finds complete parts, recordings of incomplete parts, and unfinished files."""
    plan = {"samples": 40, "seed": 1, "vary": ["height=uniform:1:2"]}
    words = (
        "sweep",
        "--out",
        "s",
        "--samples",
        "40",
        "--seed",
        "1",
        "--vary",
        "height=uniform:1:2",
        "--jobs",
        "2",
    )
    for number, least in enumerate((1, 20, 39)):
        process = start(words, tmp_path)
        while process.poll() is None and len(list(tmp_path.glob("s/*.rrd"))) < least:
            time.sleep(0.01)
        process.send_signal((signal.SIGKILL, signal.SIGTERM)[number % 2])
        _, stderr = ended(process)
        assert process.returncode in (-9, 143, 0), stderr
    last = drop(*words)
    assert (last.returncode, last.stderr) == (0, "")
    results = pl.read_parquet(tmp_path / "s" / "results.parquet")
    alone = sweep(plan_of({}, **plan), tmp_path / "alone", record=False, jobs=1).table()
    assert results.drop("recording").equals(alone.drop("recording"))
    assert [f"run-{run}.rrd" for run in range(40)] == results["recording"].to_list()
    for row in results.iter_rows(named=True):
        assert read(tmp_path / "s" / row["recording"]).scenario.height_m == row["height_m"]


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the files that a killed run left."""
    folder = tmp_path_factory.mktemp("killed")
    process, part = start(LONG, folder), folder / "run.rrd.part"
    wait_for(lambda: size(part) > 2 * ONE_BATCH, "no .part")
    process.kill()
    ended(process)
    return part.read_bytes()


@pytest.mark.long
def test_what_a_killed_run_left_is_analyzed_and_reported_as_partial(
    drop: Drop, tmp_path: Path, left: bytes
) -> None:
    part = tmp_path / "run.rrd.part"
    part.write_bytes(left)
    samples = len(read(part).states)
    # Only a batch that was not complete may be missing.
    assert samples > size(part) / BYTES_PER_SAMPLE - BATCH
    done = drop("analyze", "run.rrd.part", "--json")
    analysis = json.loads(done.stdout)
    assert (done.returncode, analysis["partial"]) == (0, True)
    assert f"never finished: this is the analysis of the {samples:,} samples" in done.stderr
    assert abs(analysis["at"][0]["error_m"] + 0.001820347613623) < 1e-15
    assert drop("render", "run.rrd.part").returncode == 0
    # Under a final name the same file is not a recording, and the line says how to read it.
    part.rename(tmp_path / "run.rrd")
    refused = drop("analyze", "run.rrd")
    assert refused.returncode == 1
    assert_one_line(refused.stdout, refused.stderr, "run.rrd.part")


def test_a_part_that_is_cut_within_a_message_gives_all_messages_before_it(
    tmp_path: Path, left: bytes
) -> None:
    part = tmp_path / "run.rrd.part"
    part.write_bytes(left)
    states = read(part).states  # the samples are read when asked for
    for less in (1, 1000, 100_000, ONE_BATCH // 2):
        part.write_bytes(left[:-less])
        cut = read(part)
        assert len(cut.states) >= len(states) - BATCH
        assert cut.states.equals(states.head(len(cut.states)))


# -- others ---------------------------------------------------------------------------------------


@pytest.mark.long
def test_while_a_recording_grows_it_can_be_read_and_a_second_writer_is_rejected(
    tmp_path: Path,
) -> None:
    process, part = start(LONG, tmp_path), tmp_path / "run.rrd.part"
    wait_for(lambda: size(part) > 1.5 * ONE_BATCH, "no .part")
    code, *output = outcome(SHORT, tmp_path)
    assert code == 1
    assert_one_line(*output, "another process is writing run.rrd")
    seen = [0]
    while len(seen) < 4:
        growing = read(part)
        assert growing.partial
        assert len(growing.states) >= seen[-1]
        if len(growing.states) > seen[-1]:
            seen.append(len(growing.states))
    process.terminate()
    ended(process)
    assert process.returncode == 143


@pytest.mark.long
def test_many_writers_of_one_target_leave_one_whole_recording(tmp_path: Path) -> None:
    """The writers start together; each finishes, or is rejected before or after its work."""
    arguments = ("simulate", "--out", "run.rrd", "--no-camera", "--force", "--duration", "0.5")
    processes = [start(arguments, tmp_path) for _ in range(3)]
    for process in processes:
        stdout, stderr = ended(process)
        assert process.returncode in (0, 1)
        said = stdout.partition("\n\nnext  ")[0] + stderr
        assert len(said.splitlines()) == 1
    assert {process.returncode for process in processes} >= {0}
    assert len(read(tmp_path / "run.rrd").states) == 121
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


@pytest.mark.long
def test_many_analyses_of_one_recording_leave_whole_files(tmp_path: Path) -> None:
    simulate(Scenario(), tmp_path / "run.rrd", camera=None)
    processes = [start(("render", "run.rrd"), tmp_path) for _ in range(2)]
    for process in processes:
        stdout, stderr = ended(process)
        assert process.returncode in (0, 1)
        said = stdout.partition("\n\nnext  ")[0] + stderr
        assert len(said.splitlines()) == 1
    assert {file.name for file in tmp_path.iterdir()} == {"run.rrd", "run.png"}
    assert (tmp_path / "run.png").read_bytes().endswith(b"IEND\xaeB`\x82")


MANY_FRAMES = (
    "simulate",
    "--out",
    "run.rrd",
    "--force",
    "--duration",
    "20",
    "--capture-every",
    "1",
)


@pytest.mark.long
@pytest.mark.skipif(cores() < 2, reason="one core draws without workers")
@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_a_frame_worker_that_dies_is_one_line_and_no_loss(
    tmp_path: Path, precious: bytes, how: signal.Signals
) -> None:
    (tmp_path / "run.rrd").write_bytes(precious)
    process = start(MANY_FRAMES, tmp_path)
    wait_for(lambda: size(tmp_path / "run.rrd.part") > 2_000_000, "no frames")
    os.kill(int(descendants_of(process.pid)[0]), how)
    output = ended(process)
    assert process.returncode == 1
    assert_one_line(*output, "worker process died", "run.rrd.part")
    assert (tmp_path / "run.rrd").read_bytes() == precious
    assert read(tmp_path / "run.rrd.part").partial


@pytest.mark.long
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_frame_workers_end_with_their_parent(tmp_path: Path, how: signal.Signals) -> None:
    process = start(MANY_FRAMES, tmp_path)
    wait_for(lambda: size(tmp_path / "run.rrd.part") > 2_000_000, "no frames")
    if how == signal.SIGINT:
        os.killpg(process.pid, how)  # as a terminal does: to all processes at once
    else:
        process.send_signal(how)
    stdout, stderr = ended(process)
    assert process.returncode == {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}[how]
    if how != signal.SIGKILL:
        assert_one_line(stdout, stderr, "run.rrd.part")
    assert len(read(tmp_path / "run.rrd.part").states) > 0


LOSING = """
import os, signal, sys
from rerun.chunk import LazyChunkStream
from drop_physics.console.running import main
how, lost = sys.argv.pop(1), sys.argv.pop(1)
write = LazyChunkStream.write_rrd
def losing(*arguments, **options):
    try:
        os.kill(os.getpid(), getattr(signal, how))
        signal.pause()
    except BaseException as failure:
        if lost == "its own error":
            raise RuntimeError(f"{type(failure).__name__}: ")
    return write(*arguments, **options)
LazyChunkStream.write_rrd = losing
main()
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("how", "code", "lost"), [("SIGINT", 130, "its own error"), ("SIGTERM", 143, "nothing")]
)
def test_a_signal_that_rerun_loses_stops_a_drop(
    tmp_path: Path, how: str, code: int, lost: str
) -> None:
    """Rerun replaces the exception raised by the signal handler with its own, which names it."""
    drops = ("simulate", "--duration", "0.1", "--no-camera", "--out", "run.rrd")
    done = subprocess.run(
        [sys.executable, "-c", LOSING, how, lost, *drops],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (code, "")
    assert not (tmp_path / "run.rrd").exists()


def test_a_ctrl_c_that_rerun_loses_stops_a_script_that_sweeps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def losing(*_: object, **__: object) -> None:
        raise RuntimeError("KeyboardInterrupt: ")

    monkeypatch.setattr(LazyChunkStream, "write_rrd", losing)
    plan = plan_of({"height_m": "1,2", "duration_s": "0.1"})
    with pytest.raises(KeyboardInterrupt):
        sweep(plan, tmp_path / "s", at_s=0.1, jobs=1)
    rows = (tmp_path / "s" / "rows.jsonl").read_text().splitlines()
    assert [*map(json.loads, rows)] == [{"sweep": json.loads(rows[0])["sweep"]}]


# -- standard output ------------------------------------------------------------------------------


def test_only_python_writes_to_standard_output() -> None:
    """Bullet prints from C, into a buffer that is flushed when the process ends."""
    code = """
import ctypes, sys, types, typer
from drop_physics.console.running import main
app = typer.Typer()
sys.modules["drop_physics.cli"] = types.SimpleNamespace(app=app)
sys.argv = ["drop"]
@app.command()
def speak():
    ctypes.CDLL(None).puts(b"from C")
    print("from Python")
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "from Python\n", "")


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a short recording."""
    folder = tmp_path_factory.mktemp("short")
    simulate(Scenario(duration_s=0.1), folder / "run.rrd", camera=None)
    return folder


@pytest.mark.long
@pytest.mark.parametrize(
    ("command", "codes", "lines"),
    [
        ("analyze run.rrd --json | head -1", (141, 0), 0),
        ("analyze run.rrd --json | true", (141, 0), 0),
        ("analyze run.rrd <&- >&- 2>&-", (0,), 0),
        ("analyze run.rrd --json >/dev/full", (1,), 1),
    ],
)
def test_standard_output_that_is_closed_or_full_ends_in_its_exit_code(
    short: Path, command: str, codes: tuple[int, ...], lines: int
) -> None:
    done = subprocess.run(
        ["bash", "-c", f'"{sys.executable}" -m drop_physics {command}; exit ${{PIPESTATUS[0]}}'],
        cwd=short,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
    )
    assert done.returncode in codes
    assert len(done.stderr.splitlines()) == lines, done.stderr


@pytest.mark.parametrize(
    ("command", "stream", "to", "code", "lines"),
    [
        ("analyze run.rrd", 1, None, 0, 0),
        ("analyze run.rrd", 2, None, 0, 0),
        ("analyze run.rrd", 1, "/dev/full", 1, 1),
        ("simulate --out new.rrd --no-camera --force", 1, None, 0, 0),
        ("simulate --out new.rrd --no-camera --force", 1, "/dev/full", 1, 1),
        ("analyze gone.rrd", 2, "/dev/full", 1, 0),
        ("analyze gone.rrd", 2, None, 1, 0),
    ],
)
def test_a_closed_or_full_standard_output_or_error_does_not_change_the_exit_code(
    short: Path, command: str, stream: int, to: str | None, code: int, lines: int
) -> None:
    """The command runs in the test's process; the test above covers how Python itself exits."""
    with (
        Path(os.devnull).open("r+") as nothing,
        tempfile.TemporaryFile("w+") as error,
        Path(to or os.devnull).open("w") as target,
    ):
        streams: list[int | None] = [nothing.fileno(), nothing.fileno(), error.fileno()]
        streams[stream] = target.fileno() if to else None
        ended = run_here(command.split(), short, streams=streams, environment=environment())
        error.seek(0)
        output = error.read()
    assert (ended, len(output.splitlines())) == (code, lines), output
    if command.startswith("simulate"):
        assert not read(short / "new.rrd").partial


def test_a_standard_output_that_gets_too_large_is_named(short: Path) -> None:
    done = subprocess.run(
        ["bash", "-c", f'ulimit -f 0; "{sys.executable}" -m drop_physics sweep --help >out.txt'],
        cwd=short,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert_one_line("", done.stderr, "standard output cannot be written: the file is too large")


def main() -> None:
    """Kill the given number of runs, when started by hand."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kills", type=int, nargs="?", default=KILLS)
    parser.add_argument("seed", type=int, nargs="?", default=SEED)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate(Scenario(duration_s=0.1), folder / "run.rrd", camera=None)
        hold_many(given.kills, given.seed, folder, (folder / "run.rrd").read_bytes())


if __name__ == "__main__":
    main()

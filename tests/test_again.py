"""Running a script again leaves its files as after a single run, whatever the script writes.

Each way of writing is a script; each verb that runs a script again takes it, and its runs end as
the first did. Afterwards contents and modes are those of a bare run in another folder, and nothing
has changed since the verb's first run.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import forked
import pytest
from conftest import some
from drop_physics.errors import DropError
from drop_physics.stages import record, why
from drop_physics.stages.record import record_script
from drop_physics.stages.rerun import again
from drop_physics.stages.sweep.script import sweep_script
from drop_physics.stages.trust import runs as trust_runs
from drop_physics.stages.trust import trust

pytestmark = pytest.mark.pybullet

SCRIPT = """
import atexit, ctypes, gzip, json, logging, mmap, multiprocessing, os, pickle, shelve, shutil
import sqlite3, subprocess, sys, tempfile, threading, zipfile
import numpy as np
import pybullet as p
elsewhere = os.environ["ELSEWHERE"]
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.8)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), basePosition=[0, 0, 1])
{before}
for i in range(20):
    p.stepSimulation()
    {during}
{after}
"""
CHILD = '[sys.executable, \'-c\', \'open("child.txt", "a").write("x")\']'
WAYS: dict[str, tuple[str, str, str]] = {
    "a file at the end": ("", "pass", "open('out.txt', 'w').write('x')"),
    "a file opened before": ("f = open('out.csv', 'w')", "print(i, file=f)", "f.close()"),
    "a file never closed": ("f = open('out.csv', 'w')", "f.write(str(i))", ""),
    "appended before": ("f = open('there.txt', 'a')", "f.write('x')", ""),
    "appended at the end": ("", "pass", "open('there.txt', 'a').write('x')"),
    "written into": ("f = open('there.txt', 'r+b')", "f.seek(1); f.write(b'z')", ""),
    "read on": ("f = open('there.txt')", "f.read(1)", "open('out.txt', 'a').write(f.read())"),
    "a descriptor": ("n = os.open('out', os.O_CREAT | os.O_WRONLY)", "os.write(n, b'x')", ""),
    "a descriptor that appends": (
        "n = os.open('there.txt', os.O_WRONLY | os.O_APPEND)",
        "os.write(n, b'x')",
        "",
    ),
    "a descriptor twice": ("f = open('out', 'w'); n = os.dup(f.fileno())", "os.write(n, b'x')", ""),
    "a file of C": (
        "c = ctypes.CDLL(None); c.fopen.restype = ctypes.c_void_p\nf = c.fopen(b'out.c', b'w')",
        "c.fputs(b'line', ctypes.c_void_p(f))",
        "",
    ),
    "a state log": ("n = p.startStateLogging(p.STATE_LOGGING_GENERIC_ROBOT, 'log')", "pass", ""),
    "a world": ("", "pass", "p.saveWorld('world.py')"),
    "a state on disk": ("", "pass", "p.saveBullet('state.bullet')"),
    "an array": ("", "pass", "np.save('out.npy', np.ones(3))"),
    "arrays": ("", "pass", "np.savez('out.npz', a=np.ones(3))"),
    "a table": ("", "pass", "np.savetxt(os.path.dirname(os.path.abspath(__file__)) + '/t', [1])"),
    "a mapped array": ("a = np.memmap('out', dtype=int, mode='w+', shape=20)", "a[i] = i", ""),
    "a map": ("f = open('there.txt', 'r+b'); m = mmap.mmap(f.fileno(), 0)", "m[0] = 90", ""),
    "a database at the end": (
        "",
        "pass",
        "d = sqlite3.connect('d.db'); d.execute('create table if not exists t (x)')\n"
        "d.execute('insert into t values (1)'); d.commit()",
    ),
    "a database opened before": (
        "d = sqlite3.connect('d.db'); d.execute('create table if not exists t (x)')",
        "d.execute('insert into t values (1)'); d.commit()",
        "",
    ),
    "a shelf": ("s = shelve.open('shelf')", "s[str(i)] = i", "s.close()"),
    "a log": ("logging.basicConfig(filename='out.log')", "logging.warning('%d', i)", ""),
    "a pickle": ("", "pass", "pickle.dump([1], open('out.pkl', 'wb'))"),
    "compressed": ("f = gzip.open('out.gz', 'at')", "f.write('x')", "f.close()"),
    "an archive": ("", "pass", "zipfile.ZipFile('out.zip', 'w').writestr('a', 'b')"),
    "renamed": ("", "pass", "os.rename('there.txt', 'moved.txt')"),
    "replaced": ("", "pass", "open('new', 'w').write('n'); os.replace('new', 'there.txt')"),
    "removed": ("", "pass", "os.remove('there.txt')"),
    "a folder": ("os.mkdir('made')", "open(f'made/{i}', 'w').write('x')", ""),
    "folders": ("", "pass", "os.makedirs('a/b/c'); open('a/b/c/d', 'w').write('x')"),
    "a folder copied": ("", "pass", "shutil.copytree('inner', 'copy')"),
    "a folder removed": ("", "pass", "shutil.rmtree('inner')"),
    "a folder moved": ("", "pass", "shutil.move('inner', 'moved')"),
    "a link": ("", "pass", "os.symlink('there.txt', 'link')"),
    "a second name": ("", "pass", "os.link('there.txt', 'name')"),
    "through a link": ("", "pass", "open('to_there', 'a').write('x')"),
    "a mode": ("", "pass", "os.chmod('there.txt', os.stat('there.txt').st_mode ^ 0o100)"),
    "a time": ("", "pass", "os.utime('there.txt', (1, os.stat('there.txt').st_mtime + 1))"),
    "cut": ("", "pass", "os.truncate('there.txt', os.path.getsize('there.txt') - 1)"),
    "a pipe": ("", "pass", "os.mkfifo('pipe')"),
    "a temporary file": ("f = tempfile.NamedTemporaryFile('w')", "f.write('x')", "f.flush()"),
    "a program": ("", "pass", f"subprocess.run({CHILD}, check=True)"),
    "a program before": (f"subprocess.run({CHILD}, check=True)", "pass", ""),
    "a child": (
        "",
        "pass",
        "if not os.fork():\n    open('c', 'a').write('x'); os._exit(0)\nos.wait()",
    ),
    "a thread": (
        "t = threading.Thread(target=lambda: open('t', 'a').write('x')); t.start(); t.join()",
        "pass",
        "",
    ),
    "a thread that goes on": (
        "go = threading.Event()\n"
        "t = threading.Thread(target=lambda: go.wait() and open('t', 'a').write('x')); t.start()",
        "pass",
        "go.set(); t.join()",
    ),
    "at exit": ("atexit.register(lambda: open('exit', 'a').write('x'))", "pass", ""),
    "elsewhere": ("f = open(elsewhere + '/out', 'a')", "f.write('x')", ""),
    "elsewhere by the engine": ("", "pass", "p.saveWorld(elsewhere + '/world.py')"),
    "elsewhere by a database": (
        "",
        "pass",
        "d = sqlite3.connect(elsewhere + '/d.db'); d.execute('create table if not exists t (x)')\n"
        "d.execute('insert into t values (1)'); d.commit()",
    ),
    "elsewhere a folder": ("", "pass", "os.mkdir(elsewhere + '/made')"),
    "elsewhere a link": ("", "pass", "os.symlink('x', elsewhere + '/link')"),
    "elsewhere a mode": (
        "there = elsewhere + '/there.txt'",
        "pass",
        "os.chmod(there, os.stat(there).st_mode ^ 0o100)",
    ),
}
CONSUMES = ("renamed", "removed", "a folder removed", "a folder moved")
"""Cases in which a second run without drop fails too: a file that it needs is gone."""
QUICK = ("a file opened before", "a state log", "a database at the end", "a folder", "elsewhere")
"""Cases that run without `-m long`."""


def by_why(script: str, *tries: str) -> set[str]:
    """Fork two runs that follow each other: the script's own once more, and one trial."""
    found = why.why(script, tries=["damping", *tries], out="../out", stdout=2)
    return {"finished"} if found.noise is not None else set()


def by_why_in_rounds(script: str) -> set[str]:
    """Fork trials, and from a second run of the script those that tell their shares."""
    return by_why(script, "timestep/2")


def by_trust(script: str) -> set[str]:
    found = trust(script, vary=["nudge", "timestep/2"], out="../out", stdout=2)
    return {variation.made.ended for variation in found.variations}


def by_sweep(script: str) -> set[str]:
    try:
        found = sweep_script(script, tries=["friction=0.2,0.4"], out="../out", stdout=2)
    except DropError:  # all runs have failed
        return {"failed"}
    return {row["ended"] for row in found.rows}


def by_record(script: str) -> set[str]:
    recorded = record_script(script, out="../out.rrd", twice=True, stdout=2)
    assert recorded.twice
    return {"finished"} if recorded.first_difference is None else {"other"}


VERBS = (by_why, by_trust, by_sweep, by_record)
FEW = [*((by_why_in_rounds, way) for way in QUICK), *((verb, QUICK[0]) for verb in VERBS[1:])]
EACH = [
    *((by_why, way) for way in WAYS if way not in QUICK),  # forks
    *(
        each  # runs from the start see a file system of their own: each third way, a verb in turn
        for each in zip(itertools.cycle(VERBS[1:]), [*WAYS][::3], strict=False)
        if each not in FEW
    ),
]


@pytest.mark.parametrize(("verb", "way"), some([*FEW, *EACH], 1))
def test_files_are_as_after_one_run(
    verb: Callable[[str], set[str]], way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, during, after = WAYS[way]
    text = SCRIPT.format(before=before, during=during, after=after)
    for name in ("bare", "ours"):
        inner = tmp_path / name / "here" / "inner"
        inner.mkdir(parents=True)
        inner.joinpath("file").write_text("file")
        inner.parent.joinpath("there.txt").write_text("there" * 5)
        inner.parent.joinpath("to_there").symlink_to("there.txt")
        inner.parent.joinpath("script.py").write_text(text)
        tmp_path.joinpath(name, "elsewhere").mkdir()
        tmp_path.joinpath(name, "elsewhere", "there.txt").write_text("there")
    monkeypatch.setenv("ELSEWHERE", str(tmp_path / "bare" / "elsewhere"))
    monkeypatch.chdir(tmp_path / "bare" / "here")
    forked.run([sys.executable, "script.py"], Path.cwd()).check_returncode()
    monkeypatch.setenv("ELSEWHERE", str(tmp_path / "ours" / "elsewhere"))
    monkeypatch.chdir(tmp_path / "ours" / "here")
    first_ended: list[dict[str, Any]] = []

    def noted(*arguments: Any, **how: Any) -> again.Again:
        first_ended.append(times_of(tmp_path / "ours"))
        return again.again_of(*arguments, **how)

    for module in (why, trust_runs, record):
        monkeypatch.setattr(module, "again_of", noted)
    assert verb("script.py") == {"finished"} or way in CONSUMES
    assert contents_of(tmp_path / "ours") == contents_of(tmp_path / "bare")
    assert [times_of(tmp_path / "ours")] == first_ended


def contents_of(folder: Path) -> dict[str, object]:
    """Return mode and content of everything that a script has written, by path."""
    return {name: (path.lstat().st_mode, held_by(path)) for name, path in written_in(folder)}


def held_by(path: Path) -> object:
    if path.is_symlink():
        return path.readlink()
    if not path.is_file():
        return None
    held = path.read_bytes()
    if path.suffix in (".db", ".gz", ".zip", ".npz", ".log") or path.name == "log":
        return len(held)  # they hold the time
    return held.replace(b"/bare/", b"/ours/")


def times_of(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return modification times, change times and inodes of files and folders."""
    return {
        name: (path.lstat().st_mtime_ns, path.lstat().st_ctime_ns, path.lstat().st_ino)
        for name, path in written_in(folder)
    }


def written_in(folder: Path) -> list[tuple[str, Path]]:
    parts = [folder / "here", folder / "elsewhere"]
    return [
        (str(path.relative_to(folder)), path)
        for part in parts
        for path in (part, *sorted(part.rglob("*")))
    ]

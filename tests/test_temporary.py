"""Files left by our killed processes are removed by the next process, and nothing else is.

Verification: a process makes a folder and is killed; of a folder's name, owner and lock, each alone
keeps it.
"""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from conftest import Drop
from drop_physics.temporary import TemporaryFolder, remove_leftovers

MAKES = """
import sys, time
from drop_physics.temporary import TemporaryFolder
folder = TemporaryFolder()
(folder.path / "work").mkdir(mode=0)
print(folder.path, flush=True)
time.sleep(600)
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder for temporary files."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_what_a_killed_process_has_made_is_removed(place: Path, drop_process: Drop) -> None:
    with subprocess.Popen([sys.executable, "-c", MAKES], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        made = Path(process.stdout.readline().decode().strip())
        assert made.parent == place
        remove_leftovers()
        assert made.is_dir()  # it lives
        process.send_signal(signal.SIGKILL)
    assert made.is_dir()
    assert drop_process("--version").returncode == 0
    assert not made.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_only_what_is_known_to_be_left_is_removed(place: Path) -> None:
    own = TemporaryFolder()
    number, started, _ = own.path.name.removeprefix("drop-").split("-")
    later = place / f"drop-{number}-{int(started) - 1}-before"
    names = "drop-notes", "drop-1-2", "drop-a-1-x", f"xdrop-{number}-1-x", "drop-7-7-file"
    for name in names[:-1]:
        (place / name).mkdir()
    (place / names[-1]).touch()
    other, held = place / "elsewhere", place / f"drop-{number}-1-held"
    for each in (later, other, held):
        each.mkdir()
    (place / f"drop-{number}-1-link").symlink_to(other)
    lock = os.open(held, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)  # as a process of another machine or container does
    before = {each.name for each in place.iterdir()}
    remove_leftovers()
    assert before - {each.name for each in place.iterdir()} == {later.name}
    os.close(lock)
    own.close()
    assert not own.path.exists()


WRITES_MEANWHILE = """
import os, shutil, sys
from drop_physics import temporary
real, meanwhile = shutil.rmtree, []
def removing(folder, **how):
    if not meanwhile:
        meanwhile.append((folder / "late").mkdir())
        return
    real(folder, **how)
shutil.rmtree = removing
with temporary.temporary_folder() as folder:
    pass
left = temporary.TemporaryFolder()
if os.fork() == 0:
    sys.exit()
os.wait()
print(folder.exists(), left.path.exists())
"""


def test_nothing_is_left_of_what_is_written_meanwhile_or_never_closed(place: Path) -> None:
    """A signal may arrive while a process starts; forked processes remove nothing."""
    done = subprocess.run(
        [sys.executable, "-c", WRITES_MEANWHILE], capture_output=True, text=True, check=False
    )
    assert done.stdout == "False True\n", done.stderr
    assert not [*place.iterdir()]

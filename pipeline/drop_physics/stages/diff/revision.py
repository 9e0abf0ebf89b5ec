"""A script as of a Git revision, in a folder that also has its data and untracked files."""

from __future__ import annotations

import contextlib
import io
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

from drop_physics.errors import DropError
from drop_physics.temporary import temporary_folder
from drop_physics.workers import users_environment

NOT_DATA = (".git", ".venv", "recordings")
"""Folders of a repository that a script does not need as data."""


@contextlib.contextmanager
def exported(script: Path, revision: str | None) -> Iterator[Path]:
    """Yield the path of a script as of a Git revision; the unchanged path if `revision` is None.

    All files of the repository are those of the revision. Files that Git does not track are copied,
    too.

    Raises
    ------
    DropError
        If Git is not installed, or has no such script or revision.
    """
    if revision is None:
        yield script
        return
    top = Path(_git(script, "rev-parse", "--show-toplevel").decode().strip())
    within = script.resolve().relative_to(top.resolve())
    archive = _git(script, "-C", str(top), "archive", "--format=tar", revision)
    with (
        temporary_folder() as folder,
        tarfile.open(fileobj=io.BytesIO(archive)) as files,
    ):
        files.extractall(folder, filter="tar")
        others = _git(script, "-C", str(top), "ls-files", "--others", "--directory", "-z")
        for name in filter(None, others.decode("utf-8", "surrogateescape").split("\0")):
            there = Path(folder, name.rstrip("/"))
            if there.parts[len(Path(folder).parts)] not in NOT_DATA and not there.exists():
                there.parent.mkdir(parents=True, exist_ok=True)
                there.symlink_to(top / name)
        found = Path(folder, within)
        if not found.is_file():
            raise DropError(
                "{script} is not in {revision}; see: git log -- {script}",
                script=str(script),
                revision=revision,
            )
        yield found


def _git(script: Path, *words: str) -> bytes:
    command = ["git", *words]
    try:
        done = subprocess.run(
            command,
            cwd=script.absolute().parent,
            env=users_environment(),
            capture_output=True,
            check=False,
        )
    except OSError as error:
        raise DropError("--rev needs git: {reason}", reason=error.strerror) from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines() or [""]
        raise DropError("git says of {script}: {why}", script=str(script), why=said[-1])
    return done.stdout

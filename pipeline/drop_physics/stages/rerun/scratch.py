"""Copy a working directory for a repeated run, if the script writes files there.

Folders are created; files are links to the originals, except files that the script writes, which
are copied. So several runs can go on at once, and their writes are discarded.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from drop_physics.temporary import temporary_folder

MOST_ENTRIES = 5000
"""Most files and folders in a folder that is copied."""
LEFT_OUT = (".git", "recordings", "__pycache__")
"""Folders that are not copied, since no run needs them."""


def can_be_copied(folder: Path) -> bool:
    """Return whether a folder is small enough to be copied for each run."""
    count = 0
    for _, folders, files in os.walk(folder):
        folders[:] = [each for each in folders if each not in LEFT_OUT]
        count += len(folders) + len(files)
        if count > MOST_ENTRIES:
            return False
    return True


@contextmanager
def scratch_copy(folder: Path, written: Collection[Path]) -> Iterator[Path]:
    """Yield a copy of a folder; files that a script writes are copied, others are links."""
    with temporary_folder() as copy:
        for at, folders, files in os.walk(folder):
            folders[:] = [each for each in folders if each not in LEFT_OUT]
            here = copy / Path(at).relative_to(folder)
            for each in folders:
                here.joinpath(each).mkdir()
            for file in files:
                own = Path(at, file)
                if own in written:
                    shutil.copy2(own, here / file)
                else:
                    here.joinpath(file).symlink_to(own)
        yield copy

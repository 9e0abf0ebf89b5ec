"""Notes which files, devices and networks a script's run used, apart from its simulation."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

MOST_ENTRIES = 5000
"""Largest number of files and folders of a working directory that is scanned for changes."""
LEFT_OUT = (".git", "recordings", "__pycache__")
"""Names of folders that are not scanned, since no script writes to them on purpose."""
KEEPS, THERE = "keeps", "keeps there"
"""Codes for a file that the script writes in its working directory: by a relative path, or by any
other path."""
MAKES = "makes"
"""Code for a file that did not exist before."""


@dataclass(frozen=True)
class Reached:
    """The files, devices and networks that a script's run used."""

    noted: tuple[tuple[str, str], ...] = ()
    """The run's reports, each a code (`connects`, `starts`, `opens`, `writes`, `removes`, `keeps`,
    `keeps there`) and a name."""
    made: tuple[str, ...] = ()
    """Paths of files and folders that the run created."""
    changed: tuple[str, ...] = ()
    """Paths in the working directory that the run changed or removed."""
    is_known: bool = True
    """Whether the working directory was scanned for changes, which a large one is not."""
    processor_s: float = 0.0
    """Processor time of the run [s]."""

    def names(self, *kinds: str) -> list[str]:
        """Return the names of the resources that were used in the given ways."""
        return [name for kind, name in self.noted if kind in kinds]

    @property
    def writes(self) -> bool:
        """True if the run writes any file, anywhere."""
        return bool(self.noted or self.made or self.changed) or not self.is_known


State = Mapping[str, tuple[int, int, int, int]]
"""Mode, size, modification time [ns] and inode of each file and folder, by path."""


def state_of(folder: Path) -> State | None:
    """Return the state of a folder and its contents; None if it is too large."""
    found: dict[str, tuple[int, int, int, int]] = {}
    for at, folders, files in os.walk(folder):
        folders[:] = [each for each in folders if each not in LEFT_OUT]
        for name in (*folders, *files):
            path = f"{at}{os.sep}{name}"
            try:
                status = os.lstat(path)
            except OSError:  # it is gone
                continue
            # A folder changes with what is in it, which has a state of its own.
            changed = 0 if name in folders else status.st_mtime_ns
            size = 0 if name in folders else status.st_size
            found[path] = status.st_mode, size, changed, status.st_ino
        if len(found) > MOST_ENTRIES:
            return None
    return found


def reached_of(
    noted: Iterable[tuple[str, str]],
    before: State | None,
    after: State | None,
    processor_s: float,
) -> Reached:
    """Return the resources that a run used, from its reports and its folder before and after."""
    told = [*noted]
    made = [name for kind, name in told if kind == MAKES]
    changed: list[str] = []
    if before is not None and after is not None:
        made += after.keys() - before.keys()
        changed = sorted(path for path, state in before.items() if after.get(path) != state)
    return Reached(
        tuple(each for each in told if each[0] != MAKES),
        tuple(sorted({*made})),
        tuple(changed),
        before is not None and after is not None,
        processor_s,
    )

"""Isolates repeated runs of a script, so that they cannot disturb files or each other.

If the kernel offers private mounts, each run has a view of the file system of its own
(`engines.watching.private`): files made by the first run are absent, and its writes are discarded.
Elsewhere it runs in a copy of its working directory, if it writes nothing else.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drop_physics.engines.channel import WATCHING
from drop_physics.engines.reached import KEEPS, THERE, Reached
from drop_physics.engines.script import Program
from drop_physics.errors import DropError
from drop_physics.fields import all_of
from drop_physics.messages import Message
from drop_physics.stages.rerun.scratch import scratch_copy
from drop_physics.temporary import temporary_folder
from drop_physics.workers import under_load

LONGEST = 10.0
"""Time limit of a run, as a multiple of the duration of the script's own run."""
LEAST_S = 2.0
"""Least time limit of a run [s]."""
SHARED_MEMORY = "/dev/shm"
WORDS = {
    "connects": Message("connects to {name}"),
    "starts": Message("starts {name}"),
    "opens": Message("opens {name}"),
    "writes": Message("writes {name}"),
    "removes": Message("removes {name}"),
}
"""Descriptions of resources that a script may access beside its simulation."""
BEYOND_FILES = ("connects", "opens")
"""Resources that cannot be isolated by a private view of the file system."""


@dataclass(frozen=True)
class Again:
    """How a script can be run again without side effects.

    Parameters
    ----------
    folders
        Folders in which a run may write; the writes go to a file-system layer of the run. If empty,
        runs write to the real files.
    made
        Files and folders that the script's first run created, hidden from later runs.
    network
        Whether a run with its own file-system layers may use the network.
    copied
        Files that the script writes in its working directory; if any, each run works in a copy of
        that directory.
    parts
        Whether runs may be forked from a shared process.
    alone
        Whether runs would write the same files, so that they must run one after another.
    took_s, processor_s
        Duration and processor time of the script's first run [s]; infinite if unknown.
    """

    folders: tuple[str, ...] = ()
    made: tuple[str, ...] = ()
    network: bool = True
    copied: tuple[Path, ...] = ()
    parts: bool = True
    alone: bool = False
    took_s: float = float("inf")
    processor_s: float = float("inf")

    @contextmanager
    def ready(self, program: Program, *, finer: int = 1) -> Iterator[Program]:
        """Yield a program prepared for a repeated run, and discard what it writes afterwards.

        Parameters
        ----------
        program
            The script to run, with its settings.
        finer
            Largest number of engine steps per script step, in this run and in runs forked from it.
        """
        limited = replace(program, limits=self.limits(finer))
        if self.folders:
            with temporary_folder() as scratch:
                private = {
                    "scratch": str(scratch),
                    "folders": [*self.folders],
                    "made": [*self.made],
                    "network": self.network,
                }
                yield replace(limited, private=private)
        elif self.copied:
            with scratch_copy(Path.cwd().resolve(), self.copied) as copy:
                yield replace(limited, scratch=str(copy), target=_from_home(program))
        else:
            yield limited

    def patience_s(self, finer: int = 1) -> float:
        """Return the time limit of a run, scaled by the machine's current load [s]."""
        return under_load(max(LEAST_S, LONGEST * self.took_s) * finer)

    def limits(self, finer: int = 1) -> dict[str, Any]:
        """Return the limits of a run, as `watching.limits` expects them."""
        most_s = max(LEAST_S, LONGEST * self.processor_s) * finer
        return {
            "processor_s": None if most_s == float("inf") else most_s,
            "bytes": _memory_bytes(),
        }


def again_of(
    target: str, reached: Reached, *, is_module: bool, took_s: float, anyway: bool
) -> Again:
    """Decide how a script is run again, from what its first run accessed.

    Parameters
    ----------
    target, is_module
        The script's path, or a module's name.
    reached
        Files, devices and networks that the script's first run used.
    took_s
        Duration of the first run [s].
    anyway
        Whether to run the script again even if that has side effects.

    Raises
    ------
    DropError
        If a repeated run would have side effects, and `anyway` is false.
    """
    folders = folders_of(None if is_module else Path(target), reached)
    private = is_offered(folders)
    refused = BEYOND_FILES if private else tuple(WORDS)
    beyond = [each for each in reached.noted if each[0] in refused]
    if not private and not reached.is_known:
        beyond.append(("writes", str(Path.cwd())))
    there = [("writes", name) for name in reached.names(THERE)]
    beyond += [] if private else there
    if beyond and not anyway:
        first = dict(reversed(beyond))
        raise DropError(
            "{script} {what}, and would do so in each run; --again runs it all the same",
            script=target,
            what=all_of(Message(WORDS[how], name=name) for how, name in first.items()),
        )
    limited = Again(took_s=took_s, processor_s=reached.processor_s or float("inf"))
    if private:
        return replace(
            limited,
            folders=tuple(folders),
            made=reached.made,
            network=bool(reached.names("connects")),
            parts=not beyond,
        )
    written = {*reached.names(KEEPS), *reached.changed, *reached.made}
    copied = () if beyond else tuple(map(Path, sorted(written)))
    return replace(limited, copied=copied, parts=not reached.writes, alone=bool(beyond))


def folders_of(script: Path | None, reached: Reached) -> list[str]:
    """Return the existing folders that a script may write to."""
    written = reached.names("writes", "removes", THERE)
    found = [
        Path.cwd(),
        *([] if script is None else [script.resolve().parent]),
        Path(tempfile.gettempdir()),
        Path.home(),
        Path(SHARED_MEMORY),
        *(Path(name).parent for name in written),
    ]
    return sorted({str(each.resolve()) for each in found if each.is_dir()})


@functools.cache
def _is_offered(folders: tuple[str, ...], here: str) -> bool:
    del here
    if not sys.platform.startswith("linux"):
        return False
    with temporary_folder() as scratch:
        view = {"scratch": str(scratch), "folders": [*folders], "made": [], "network": False}
        command = [sys.executable, "-IS", str(WATCHING), "watching.private", json.dumps(view)]
        tried = subprocess.run(command, stderr=subprocess.DEVNULL, check=False)
    return tried.returncode == 0


def is_offered(folders: Sequence[str]) -> bool:
    """Return whether the kernel allows private overlay mounts over the given folders."""
    return _is_offered(tuple(folders), str(Path.cwd()))


def _memory_bytes() -> int | None:
    """Return this machine's memory [bytes]; None if unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None


def _from_home(program: Program) -> str:
    """Return the path of a script, valid in any working directory."""
    return program.target if program.is_module else str(Path(program.target).absolute())

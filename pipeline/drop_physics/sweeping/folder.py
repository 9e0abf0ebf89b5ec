"""A sweep's folder: its description, the finished parts, and the results made of them.

sweep.json              the sweep that this folder belongs to; another one is rejected
parts/part-000003.parquet   one per shard, written whole or not at all
results.parquet         all parts in one, in the order of the runs
recordings/run-12.rrd   one per run, if recordings are kept

Every table is stamped with the sweep and its name, and every recording has an id derived from the
sweep and its run. A file without them is not this sweep's: it is not used, replaced or deleted.
A part also holds the digests of its recordings, so that one that was altered later is noticed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import polars as pl

from drop_physics.errors import OutputError, RecordingError
from drop_physics.fields import Option
from drop_physics.files.outputs import make_folder, part_of, written
from drop_physics.files.table import written_by_polars
from drop_physics.files.whole import lock, opened, written_whole
from drop_physics.messages import Message
from drop_physics.scenario import Scenario
from drop_physics.sweeping.plan import Plan
from drop_physics.sweeping.stamp import UNSTAMPED, fault_of, stamp

Row = dict[str, Any]

_TYPES: dict[type, Any] = {float: pl.Float64, int: pl.Int64, str: pl.String}


def _column(option: Option) -> Any:  # noqa: ANN401 - a polars class, or an instance
    if option.is_flag:
        return pl.Boolean
    kind = _TYPES[option.kind.of]
    return pl.List(kind) if option.kind.components else kind


SCHEMA: dict[str, Any] = {
    "run": pl.Int64,
    "sample": pl.Int64,
    **{name: _column(option) for name, option in Scenario.options().items()},
    "step": pl.Int64,
    "time_s": pl.Float64,
    "phase": pl.String,
    "simulated_m": pl.Float64,
    "free_fall_m": pl.Float64,
    "error_m": pl.Float64,
    "timestep_m": pl.Float64,
    "damping_m": pl.Float64,
    "interaction_m": pl.Float64,
    "rounding_m": pl.Float64,
    "end_m": pl.Float64,
    "recording": pl.String,
    "command": pl.String,
    "error": pl.String,
}
"""Columns of a part. `step` to `rounding_m` are those of the sample nearest to `--at`, `end_m` is
the height in the last sample; `command` repeats the run; `error` says why it failed."""

TERMS = ("error_m", "timestep_m", "damping_m", "interaction_m", "rounding_m")

_WRITTEN: dict[str, Any] = {"recording_bytes": pl.Int64, "recording_sha256": pl.String}
"""Columns that only parts have: what the recording was when the part was written."""

EXPLAINED = pl.all_horizontal(pl.col(TERMS).is_not_null())
"""Rows whose error was broken down: the sample was in the air, in simulation and in theory."""

FLAT_RECORDINGS = 1000
"""Up to this many recordings share a folder; more are split into folders of this many."""


def mark_of(identity: Mapping[str, Any]) -> str:
    """Return what identifies a sweep's own files: a digest of all that determines its rows."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


MOST_PART_BYTES = 1 << 26
"""A part has a few thousand rows at most, of less than a kilobyte each."""
MOST_IDENTITY_BYTES = 1 << 22
"""Limit of a sweep's description, including its lists of values."""


class Folder:
    """A sweep's folder; `mark` identifies its own files."""

    def __init__(self, path: Path, mark: str = "") -> None:
        self.path = path
        self.mark = mark
        self.results = path / "results.parquet"
        self.recordings = path / "recordings"
        self._parts = path / "parts"
        self._identity = path / "sweep.json"

    @contextlib.contextmanager
    def claimed(self, identity: Mapping[str, Any]) -> Iterator[None]:
        """Claim the folder for one sweep, and lock out others while the block runs.

        Raises
        ------
        OutputError
            If it holds another sweep, is in use by another process, or cannot be created.
        """
        make_folder(self.path, "--out")
        make_folder(self._parts, "--out")
        try:
            with opened(self.path / ".lock") as handle:
                lock(
                    handle,
                    Message(
                        "another sweep is running in {folder}; wait, or choose another --out",
                        folder=self.path,
                    ),
                )
                self._check_identity(json.loads(json.dumps(identity)))
                yield
        except OSError as error:
            raise OutputError(
                "{path} cannot be written: {reason}; choose another folder with --out",
                path=written(error) or self.path,
                reason=error.strerror or str(error),
            ) from None

    def _check_identity(self, identity: dict[str, Any]) -> None:
        if not self._identity.is_file():
            files = (self.results, *self._parts.iterdir(), *self.recordings.glob("*"))
            if any(map(os.path.lexists, files)):
                raise OutputError(
                    "{folder} has results of something else; choose another --out", folder=self.path
                )
            with written_whole(self._identity, force=False) as file:
                file.write(json.dumps(identity, indent=2).encode() + b"\n")
            return
        try:
            with self._identity.open("rb") as file:
                known = json.loads(file.read(MOST_IDENTITY_BYTES))
            differs = [key for key in identity if identity[key] != known.get(key)]
        except (ValueError, AttributeError, RecursionError):
            raise OutputError(
                "{path} is damaged; choose another --out", path=self._identity
            ) from None
        if differs:
            raise OutputError(
                "{folder} holds another sweep (differs in {keys}, see {path}); choose another "
                "--out, or repeat its command to resume it",
                folder=self.path,
                keys=", ".join(differs),
                path=self._identity,
            )

    def part(self, shard: int) -> Path:
        """Return the file of a shard."""
        return self._parts / f"part-{shard:06d}.parquet"

    def finished(self) -> set[int]:
        """Return the shards whose part exists, whatever is in it."""
        names = {path.name for path in self._parts.glob("part-*.parquet")}
        numbers = {name[5:-8] for name in names}
        shards = {int(number) for number in numbers if number.isdecimal()}
        return {shard for shard in shards if self.part(shard).name in names}

    def check_replaceable(self, plan: Plan, *, recorded: bool) -> None:
        """Make sure that a sweep replaces nothing but its own files.

        Raises
        ------
        OutputError
            If another file has one of their names.
        """
        if os.path.lexists(self.results):
            with self._own(self.results):
                pass
        if not (recorded and self.recordings.exists()):
            return
        for shard in sorted(set(range(plan.shards)) - self.finished()):
            for run in plan.runs_of(shard):
                self.check_recording(plan, run)

    def write(self, shard: int, rows: Sequence[Row]) -> pl.DataFrame:
        """Write the part of a shard, and return it.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        part = pl.DataFrame([row | self._written(row) for row in rows], schema=SCHEMA | _WRITTEN)
        with self._stamped(self.part(shard)) as file:
            part.write_parquet(file, metadata=UNSTAMPED)
        return part

    def read(self, shard: int) -> pl.DataFrame:
        """Return the part of a shard.

        Raises
        ------
        OutputError
            If any bit of it has changed since this sweep wrote it.
        """
        with self._own(self.part(shard)) as file:
            return pl.read_parquet(file)

    @contextlib.contextmanager
    def _stamped(self, path: Path) -> Iterator[BinaryIO]:
        with written_by_polars(path, force=False, ours=True) as file:
            yield file
            stamp(file, self._owner(path))

    @contextlib.contextmanager
    def _own(self, path: Path) -> Iterator[BinaryIO]:
        """Open a table of this sweep; anything else is rejected unparsed."""
        fault: Message | None = Message("it is not a file")
        if path.is_file():
            with path.open("rb") as file:
                parts = 1 if path != self.results else max(1, len(self.finished()))
                fault = fault_of(file, self._owner(path), most_bytes=MOST_PART_BYTES * parts)
                if fault is None:
                    file.seek(0)
                    yield file
        if fault is not None:
            raise OutputError(
                "{path} is not what this sweep wrote: {fault}; move it away and repeat the "
                "command, or replace it with --force",
                path=path,
                fault=fault,
            )

    def _owner(self, path: Path) -> str:
        return f"{self.mark} {path.name}"

    def recording(self, plan: Plan, run: int) -> Path:
        """Return the file of a run's recording."""
        many = plan.runs > FLAT_RECORDINGS
        folder = self.recordings / f"{run // FLAT_RECORDINGS:06d}" if many else self.recordings
        return folder / f"run-{run}.rrd"

    def recording_id(self, run: int) -> str:
        """Return the id of a run's recording, the same each time this sweep makes it."""
        return hashlib.sha256(f"{self.mark} {run}".encode()).hexdigest()[:32]

    def check_recording(self, plan: Plan, run: int) -> None:
        """Make sure that no recording of a run exists, or one that this sweep made.

        Raises
        ------
        OutputError
            If another file has its name.
        """
        path = self.recording(plan, run)
        if os.path.lexists(path) and not self._is_own(path, run):
            raise OutputError(
                "{path} must be this sweep's recording of run {run}, and is something else; move "
                "it away and repeat the command, or replace it with --force",
                path=path,
                run=run,
            )

    def lacks_recording(self, plan: Plan, rows: pl.DataFrame) -> bool:
        """Return whether a recording that was made with these rows is gone.

        Raises
        ------
        OutputError
            If one is there that is not, to the last bit, what this sweep wrote.
        """
        lacks = False
        made = rows.filter(pl.col("recording").is_not_null())
        for run, *known in made["run", *_WRITTEN].rows():
            path = self.recording(plan, run)
            if not os.path.lexists(path):
                lacks = True
            elif _digest(path, due_bytes=known[0]) != tuple(known):
                raise OutputError(
                    "{path} is not what this sweep wrote: {fault}; move it away and repeat the "
                    "command, or replace it with --force",
                    path=path,
                    fault=Message("it was altered or replaced"),
                )
        return lacks

    def _written(self, row: Row) -> Row:
        path = row["recording"] and self.path / row["recording"]
        size, digest = (None, None) if path is None else _digest(path)
        return dict(zip(_WRITTEN, (size, digest), strict=True))

    def discard_unfinished(self, plan: Plan, run: int) -> None:
        """Remove the unfinished recording of a run that a killed worker of this sweep left."""
        part = part_of(self.recording(plan, run))
        if not part.is_file() or part.is_symlink():
            return
        from drop_physics.recording.reader import recording_id

        with contextlib.suppress(RecordingError):  # not ours
            if recording_id(part) == self.recording_id(run):
                part.unlink()

    def _is_own(self, path: Path, run: int) -> bool:
        from drop_physics.recording.reader import read  # not needed without recordings

        try:
            return read(path).recording_id == self.recording_id(run)
        except RecordingError:
            return False

    def discard(self, plan: Plan, shard: int) -> None:
        """Remove the part of a shard, and this sweep's own recordings of its runs.

        Their names come from the plan, because a name that is read from a file could be any.
        """
        for run in plan.runs_of(shard):
            path = self.recording(plan, run)
            if os.path.lexists(path) and self._is_own(path, run):
                path.unlink()
        self.part(shard).unlink()

    def merge(self, shards: int) -> pl.LazyFrame:
        """Merge the first parts into the results, and return them, without loading all rows.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        with self._stamped(self.results) as file:
            parts = pl.scan_parquet([self.part(shard) for shard in range(shards)])
            parts.drop(*_WRITTEN).sink_parquet(file, metadata=UNSTAMPED)
        return pl.scan_parquet(self.results)


def _digest(path: Path, *, due_bytes: int | None = None) -> tuple[int, str]:
    """Return a file's size and digest; one of another size than `due_bytes` is not read."""
    size = path.stat().st_size if path.is_file() else -1
    if due_bytes is not None and size != due_bytes:
        return size, ""
    with path.open("rb") as file:
        return size, hashlib.file_digest(file, "sha256").hexdigest()

"""A sweep's folder: what it is, the parts that are finished, and the results made of them.

sweep.json              the sweep that lives here; another one is rejected
parts/part-000003.parquet   one per shard, written whole or not at all
results.parquet         all parts in one, in the order of the runs
recordings/run-12.rrd   one per run, unless they were not to be kept
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from pipeline.errors import OutputError
from pipeline.fields import integer, number, orientation, vector
from pipeline.recording.files import lock, opened, written_whole
from pipeline.recording.outputs import make_folder
from pipeline.recording.table import written_by_polars
from pipeline.scenario import Scenario, gravity
from pipeline.sweeping.plan import Plan

Row = dict[str, Any]

_TYPES: dict[Any, Any] = {
    number: pl.Float64,
    gravity: pl.Float64,
    vector: pl.List(pl.Float64),
    orientation: pl.List(pl.Float64),
    integer: pl.Int64,
}
"""What a column holds whose option is read by this function; a text is a text."""

SCHEMA: dict[str, Any] = {
    "run": pl.Int64,
    "sample": pl.Int64,
    **{
        name: pl.Boolean if option.is_flag else _TYPES.get(option.parse, pl.String)
        for name, option in Scenario.options().items()
    },
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
the height in the last sample; `command` makes the run again; `error` says why it failed."""

TERMS = ("error_m", "timestep_m", "damping_m", "interaction_m", "rounding_m")

EXPLAINED = pl.all_horizontal(pl.col(TERMS).is_not_null())
"""Rows whose error was broken down: the sample was in the air."""

FLAT_RECORDINGS = 1000
"""Up to so many recordings lie side by side; more are put into folders of so many."""


class Folder:
    """A sweep's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.results = path / "results.parquet"
        self.recordings = path / "recordings"
        self._parts = path / "parts"
        self._identity = path / "sweep.json"

    @contextlib.contextmanager
    def claimed(self, identity: Mapping[str, Any]) -> Iterator[None]:
        """Make the folder that of one sweep, and keep others out while the block runs.

        Raises
        ------
        OutputError
            If it holds another sweep, is in use by another process, or cannot be made.
        """
        make_folder(self.path, "--out")
        make_folder(self._parts, "--out")
        try:
            with opened(self.path / ".lock") as handle:
                lock(
                    handle,
                    f"another sweep is running in {self.path}; wait, or choose another --out",
                )
                self._check_identity(json.loads(json.dumps(identity)))
                yield
        except OSError as error:
            raise OutputError(
                f"{error.filename or self.path} cannot be written: {error.strerror or error}; "
                "choose another folder with --out"
            ) from None

    def _check_identity(self, identity: dict[str, Any]) -> None:
        if not self._identity.is_file():
            there = (self.results, *self._parts.iterdir(), *self.recordings.glob("*"))
            if any(map(os.path.lexists, there)):
                raise OutputError(
                    f"{self.path} has results of something else; choose another --out"
                )
            with written_whole(self._identity, force=False) as file:
                file.write(json.dumps(identity, indent=2).encode() + b"\n")
            return
        try:
            known = json.loads(self._identity.read_bytes())
            differs = [key for key in identity if identity[key] != known.get(key)]
        except (ValueError, AttributeError):
            raise OutputError(f"{self._identity} is damaged; choose another --out") from None
        if differs:
            raise OutputError(
                f"{self.path} holds another sweep (differs in {', '.join(differs)}, see "
                f"{self._identity}); choose another --out, or repeat its command to go on with it"
            )

    def part(self, shard: int) -> Path:
        """Return the file of a shard."""
        return self._parts / f"part-{shard:06d}.parquet"

    def finished(self) -> set[int]:
        """Return the shards that have been written."""
        names = {path.name for path in self._parts.glob("part-*.parquet") if path.is_file()}
        found = {name[5:-8] for name in names}
        shards = {int(one) for one in found if one.isdecimal()}
        return {shard for shard in shards if self.part(shard).name in names}

    def write(self, shard: int, rows: Sequence[Row]) -> pl.DataFrame:
        """Write the part of a shard, and return it.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        part = pl.DataFrame(rows, schema=SCHEMA)
        with written_by_polars(self.part(shard)) as file:
            part.write_parquet(file)
        return part

    def read(self, shard: int) -> pl.DataFrame:
        """Return the part of a shard.

        Raises
        ------
        OutputError
            If it is not one.
        """
        try:
            part = pl.read_parquet(self.part(shard))
        except pl.exceptions.PolarsError:
            part = pl.DataFrame()
        if part.schema != pl.Schema(SCHEMA):
            raise OutputError(f"{self.part(shard)} is damaged; delete it, and repeat the command")
        return part

    def recording(self, plan: Plan, run: int) -> Path:
        """Return the file of a run's recording."""
        many = plan.runs > FLAT_RECORDINGS
        folder = self.recordings / f"{run // FLAT_RECORDINGS:06d}" if many else self.recordings
        return folder / f"run-{run}.rrd"

    def discard(self, plan: Plan, shard: int) -> None:
        """Remove the part of a shard, and the recordings of its runs.

        Which they are is known from the plan: a name that is read from a file might be any.
        """
        for run in plan.runs_of(shard):
            self.recording(plan, run).unlink(missing_ok=True)
        self.part(shard).unlink()

    def merge(self, shards: int) -> pl.LazyFrame:
        """Make the results of the first parts, and return them; rows are not held in memory.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        with written_by_polars(self.results) as file:
            pl.scan_parquet([self.part(shard) for shard in range(shards)]).sink_parquet(file)
        return pl.scan_parquet(self.results)

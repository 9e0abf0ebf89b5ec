"""A sweep's folder: its description, the finished parts, and the results made of them.

sweep.json              the sweep that this folder belongs to; another one is rejected
parts/part-000003.parquet   one per shard, written whole or not at all
results.parquet         all parts in one, in the order of the runs
recordings/run-12.rrd   one per run, if recordings are kept

A folder with a `sweep.json` is its sweep's: what it writes there replaces what has its name.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from drop_physics.errors import OutputError
from drop_physics.fields import Option
from drop_physics.files.outputs import make_folder, written
from drop_physics.files.table import written_by_polars
from drop_physics.files.whole import lock, opened, written_whole
from drop_physics.messages import Message
from drop_physics.scenario import Scenario
from drop_physics.sweeping.plan import Plan

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

EXPLAINED = pl.all_horizontal(pl.col(TERMS).is_not_null())
"""Rows whose error was broken down: the sample was in the air, in simulation and in theory."""

FLAT_RECORDINGS = 1000
"""Most recordings in one folder; more are split into folders of this many."""


MOST_IDENTITY_BYTES = 1 << 22
"""Limit of a sweep's description, including its lists of values."""


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
        """Claim the folder for one sweep, and lock out others while the block runs.

        Raises
        ------
        OutputError
            If it holds another sweep, is in use by another process, or cannot be created.
        """
        make_folder(self.path)
        make_folder(self._parts)
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

    def finished(self, plan: Plan) -> Iterator[tuple[int, pl.DataFrame]]:
        """Yield the shards of a plan that are finished, each with its part.

        A shard whose recordings are gone is not finished.

        Raises
        ------
        OutputError
            If a part is not one of this plan's.
        """
        for shard in range(plan.shards):
            if os.path.lexists(self.part(shard)):
                part = self._read(plan, shard)
                recordings = part["recording"].drop_nulls()
                if all((self.path / name).exists() for name in recordings):
                    yield shard, part

    def _read(self, plan: Plan, shard: int) -> pl.DataFrame:
        path = self.part(shard)
        try:
            part = pl.read_parquet(path)
        except (pl.exceptions.PolarsError, OSError):
            part = pl.DataFrame()
        if part.schema != SCHEMA or part["run"].to_list() != [*plan.runs_of(shard)]:
            raise OutputError(
                "{path} does not hold runs of this sweep; move it away, and repeat the command",
                path=path,
            )
        return part

    def write(self, shard: int, rows: Sequence[Row]) -> pl.DataFrame:
        """Write the part of a shard, and return it.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        part = pl.DataFrame(rows, schema=SCHEMA)
        with written_by_polars(self.part(shard), force=True) as file:
            part.write_parquet(file)
        return part

    def recording(self, plan: Plan, run: int) -> Path:
        """Return the file of a run's recording."""
        many = plan.runs > FLAT_RECORDINGS
        folder = self.recordings / f"{run // FLAT_RECORDINGS:06d}" if many else self.recordings
        return folder / f"run-{run}.rrd"

    def merge(self, shards: int) -> pl.LazyFrame:
        """Merge the first parts into the results, and return them, without loading all rows.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        with written_by_polars(self.results, force=True) as file:
            pl.scan_parquet([self.part(shard) for shard in range(shards)]).sink_parquet(file)
        return pl.scan_parquet(self.results)

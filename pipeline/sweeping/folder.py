"""A sweep's folder: what it is, the parts that are finished, and the results made of them.

sweep.json              the sweep that lives here; another one is turned away
parts/part-000003.parquet   one per shard, written whole or not at all
results.parquet         all parts in one, in the order of the runs
recordings/run-12.rrd   one per run, unless they were not to be kept
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from pipeline.errors import OutputError
from pipeline.fields import integer, number, orientation, vector
from pipeline.recording.files import lock, written_whole
from pipeline.scenario import Scenario, gravity

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
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            with (self.path / ".lock").open("ab") as handle:
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
        if not self._identity.exists():
            if self.results.exists() or any(self._parts.iterdir()):
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
        names = (path.stem.removeprefix("part-") for path in self._parts.glob("part-*.parquet"))
        return {int(name) for name in names if name.isdecimal()}

    def write(self, shard: int, rows: Sequence[Row]) -> None:
        """Write the part of a shard.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        with written_whole(self.part(shard)) as file:
            pl.DataFrame(rows, schema=SCHEMA).write_parquet(file)

    def read(self, shard: int) -> pl.DataFrame:
        """Return the part of a shard."""
        return pl.read_parquet(self.part(shard))

    def discard(self, shard: int) -> None:
        """Remove the part of a shard, and the recordings of its runs."""
        for name in self.read(shard)["recording"].drop_nulls():
            (self.path / name).unlink(missing_ok=True)
        self.part(shard).unlink()

    def merge(self, shards: int) -> pl.LazyFrame:
        """Make the results of the first parts, and return them; rows are not held in memory.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        with written_whole(self.results) as file:
            pl.scan_parquet([self.part(shard) for shard in range(shards)]).sink_parquet(file)
        return pl.scan_parquet(self.results)

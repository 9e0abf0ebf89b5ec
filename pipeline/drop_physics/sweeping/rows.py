"""Stores the rows of a sweep one by one, so that an interrupted sweep can be resumed."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from drop_physics.fields import Option
from drop_physics.files.outputs import output_errors
from drop_physics.files.table import written_by_polars
from drop_physics.files.whole import written_whole
from drop_physics.scenario import Scenario

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
"""Columns of a sweep's results. `step` to `rounding_m` describe the sample nearest to `--at`,
`end_m` is the height in the last sample; `command` repeats the run; `error` gives the reason why it
failed."""

TERMS = ("error_m", "timestep_m", "damping_m", "interaction_m", "rounding_m")


@contextlib.contextmanager
def kept_rows(path: Path, sweep_id: str) -> Iterator[tuple[dict[int, Row], Callable[[Row], None]]]:
    """Yield the rows left by an interrupted sweep, by run, and a function that stores a row.

    Rows of other sweeps, and incomplete rows, are dropped.
    """
    rows = _left(path, sweep_id)
    with written_whole(path, force=True, ours=True) as file:
        for each in ({"sweep": sweep_id}, *rows.values()):
            file.write(_line(each))
    with path.open("ab", buffering=0) as table:  # what is written is there, whatever comes

        def add(row: Row) -> None:
            with output_errors(path):
                table.write(_line(row))

        yield rows, add


def _line(row: Row) -> bytes:
    return json.dumps(row).encode() + b"\n"


def _left(path: Path, sweep_id: str) -> dict[int, Row]:
    rows: dict[int, Row] = {}
    with contextlib.suppress(OSError, ValueError, RecursionError):
        first, *lines = path.read_bytes().splitlines()
        if json.loads(first) == {"sweep": sweep_id}:
            for line in lines:
                row = json.loads(line)
                rows[row["run"]] = row
    return rows


def write_rows(path: Path, rows: Sequence[Row], schema: Mapping[str, Any] | None = None) -> None:
    """Write the rows of a sweep as one Parquet file; without a schema, types are inferred."""
    if schema is None:
        columns = dict.fromkeys(name for row in rows for name in row)
        table = pl.DataFrame(
            {name: pl.Series([row.get(name) for row in rows], strict=False) for name in columns}
        )
    else:
        table = pl.DataFrame(rows, schema=schema)
    with written_by_polars(path, force=True) as file:
        table.write_parquet(file)

"""Write the analysis table for other tools, as Parquet or CSV, with polars."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import polars as pl

from drop_physics.files.outputs import unwritable
from drop_physics.files.whole import written_whole
from drop_physics.messages import harmless

PROBE_BYTES = 1 << 16


def write_table(path: Path, samples: pl.DataFrame, *, force: bool) -> None:
    """Write a table completely or not at all; CSV keeps every digit, and is safe on a terminal.

    Raises
    ------
    OutputError
        If the file exists and `force` is not given, or cannot be written.
    """
    with written_by_polars(path, force=force) as file:
        if path.suffix == ".csv":
            texts = pl.col(pl.String).map_elements(harmless, return_dtype=pl.String)
            samples.with_columns(texts).rename(harmless).write_csv(file)
        else:
            samples.write_parquet(file)


@contextlib.contextmanager
def written_by_polars(path: Path, *, force: bool) -> Iterator[BinaryIO]:
    """Yield a file like `written_whole`, for polars to write to.

    Raises
    ------
    OutputError
        As for `written_whole`.
    """
    with written_whole(path, force=force) as file:
        try:
            yield file
        except pl.exceptions.ComputeError as error:
            # Polars loses the system's reason; writing a little more raises it again.
            file.write(bytes(PROBE_BYTES))
            file.flush()
            raise unwritable(path, str(error)) from error

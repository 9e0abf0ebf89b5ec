"""The analysis table as a file for other tools: Parquet or CSV, by polars."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from pipeline.errors import check_suffix
from pipeline.recording.files import check_target, written_whole


def check_table(path: Path, *, force: bool) -> None:
    """Make sure that a table can be written, before any work is done for it.

    Raises
    ------
    ScenarioError
        If the suffix is neither .parquet nor .csv.
    OutputError
        If the file exists and `force` is not given, or cannot be written.
    """
    check_suffix("--table", path, (".parquet", ".csv"))
    check_target(path, force=force)


def write_table(path: Path, samples: pl.DataFrame, *, force: bool) -> None:
    """Write a table whole; CSV keeps every digit.

    Raises
    ------
    OutputError
        If the file exists and `force` is not given, or cannot be written.
    """
    with written_whole(path, force=force) as file:
        try:
            if path.suffix == ".csv":
                samples.write_csv(file)
            else:
                samples.write_parquet(file)
        except pl.exceptions.ComputeError as error:  # a full disk, for one
            raise RuntimeError(str(error)) from error

"""Recordings processed by Rerun's own tools give the same values, to the last digit.

They may put rows into other chunks and another order, and write what is static again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from conftest import Drop, rerun_rrd, some
from drop_physics import Analysis, analyze
from drop_physics.errors import RecordingError
from drop_physics.recording import schema, writer
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import read
from drop_physics.stages.run import Run
from rerun.chunk import Chunk, LazyChunkStream, RrdReader


def merged(run: Path, folder: Path) -> Path:
    rerun_rrd("merge", run, "-o", folder / "merged.rrd")
    return folder / "merged.rrd"


def merged_with_its_layer(run: Path, folder: Path) -> Path:
    rerun_rrd("merge", run, run.with_name("run.analysis.rrd"), "-o", folder / "both.rrd")
    return folder / "both.rrd"


def optimized(run: Path, folder: Path) -> Path:
    rerun_rrd("optimize", run, "-o", folder / "optimized.rrd")
    return folder / "optimized.rrd"


def chopped(run: Path, folder: Path) -> Path:
    rerun_rrd("optimize", "--max-rows", 7, "--profile", "live", run, "-o", folder / "chopped.rrd")
    return folder / "chopped.rrd"


def migrated(run: Path, folder: Path) -> Path:
    (folder / "migrated.rrd").write_bytes(run.read_bytes())
    rerun_rrd("migrate", folder / "migrated.rrd")
    return folder / "migrated.rrd"


def split_and_put_together(run: Path, folder: Path) -> Path:
    """Split a recording in three, restore the parts' id, and merge them, the last one first."""
    rerun_rrd("split", "-o", folder, "--timeline", "sim_step", "-t", 50, "-t", 120, run)
    pieces = sorted(folder.glob("*.rrd"), reverse=True)
    assert len(pieces) == 3
    # Not with `rerun rrd route --recording-id`, which panics on what `split` writes (0.41).
    renamed = [rewritten(RrdReader(piece).stream(), run, piece) for piece in pieces]
    rerun_rrd("merge", *renamed, "-o", folder / "whole.rrd")
    return folder / "whole.rrd"


def rewritten(chunks: Iterable[Chunk], run: Path, path: Path) -> Path:
    """Write chunks to a file, as a recording with the same id."""
    LazyChunkStream.from_iter(list(chunks)).write_rrd(
        path, application_id=schema.APPLICATION_ID, recording_id=read(run).recording_id
    )
    return path


def backwards(run: Path, folder: Path) -> Path:
    """Write the chunks in reverse order, the closing property first."""
    return rewritten(reversed(list(RrdReader(run).stream())), run, folder / "backwards.rrd")


def numbers(analysis: Analysis) -> str:
    found = analysis.as_json()
    return json.dumps(
        {key: found[key] for key in found if key not in ("recording", "layer")},
        sort_keys=True,
    )


@pytest.mark.parametrize(
    "trip",
    some(
        [
            merged,
            merged_with_its_layer,
            optimized,
            chopped,
            migrated,
            split_and_put_together,
            backwards,
        ],
        2,
    ),
)
def test_a_round_trip_changes_no_number(
    tmp_path: Path, standard: Run, trip: Callable[[Path, Path], Path]
) -> None:
    run = standard.simulation.recording
    path = trip(run, tmp_path)
    assert path.read_bytes() != run.read_bytes() or trip is migrated
    again = analyze(path, at_s=[0.3])
    assert numbers(again) == numbers(analyze(run, at_s=[0.3], out=tmp_path / "layer.rrd"))
    assert again.table.equals(standard.analysis.table)
    assert list(frames(read(path))) == list(frames(read(run)))


def test_a_piece_of_a_recording_is_no_recording(tmp_path: Path, standard: Run) -> None:
    rerun_rrd(
        "split", "-o", tmp_path, "--timeline", "sim_step", "-t", 50, standard.simulation.recording
    )
    for piece in tmp_path.glob("*.rrd"):
        with pytest.raises(RecordingError, match="is damaged"):
            read(piece)


# -- recordings of others -------------------------------------------------------------------------


def test_a_recording_of_an_older_drop_gets_a_clear_answer(
    drop: Drop, tmp_path: Path, standard: Run
) -> None:
    def of_schema_zero(chunk: Chunk) -> Chunk:
        if chunk.entity_path != f"/__properties/{schema.RECORDING_PROPERTY}":
            return chunk
        return writer.property_chunk(
            schema.RECORDING_PROPERTY, {"schema_version": 0, "samples": 241}
        )

    LazyChunkStream.from_iter(
        map(of_schema_zero, RrdReader(standard.simulation.recording).stream())
    ).write_rrd(tmp_path / "run.rrd", application_id="drop", recording_id="old")
    for command in ("analyze", "render"):
        done = drop(command, "run.rrd")
        assert (done.returncode, done.stdout) == (1, "")
        assert len(done.stderr.splitlines()) == 1
        assert f"schema {schema.SCHEMA_VERSION}, got 0" in done.stderr


def test_a_recording_of_another_program_gets_a_clear_answer(drop: Drop, tmp_path: Path) -> None:
    import rerun as rr

    stream = rr.RecordingStream("rerun_example_other")
    stream.save(tmp_path / "run.rrd")
    stream.log("points", rr.Points3D([[0, 0, 0]]))
    stream.flush()
    stream.disconnect()
    for command in (["analyze"], ["render"]):
        done = drop(*command, "run.rrd")
        assert (done.returncode, done.stdout) == (1, "")
        assert len(done.stderr.splitlines()) == 1
        assert "'rerun_example_other'" in done.stderr

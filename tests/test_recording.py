"""The recording follows its schema, is complete or absent, and is read back bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import rerun_rrd
from drop_physics import Scenario, simulate
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import OutputError, RecordingError
from drop_physics.explain.decomposition import TERMS
from drop_physics.files.whole import renamed
from drop_physics.recording import rrd, schema, sealing
from drop_physics.recording.reader import read
from drop_physics.stages.run import Run
from drop_physics.stages.simulate.recorded import case_of
from drop_physics.trace.tables import columns_of
from rerun.chunk import Chunk, LazyChunkStream, RrdReader


def chunks_of(path: Path) -> list[Chunk]:
    return list(RrdReader(path).stream())


def table(path: Path, entity: str) -> pl.DataFrame:
    found = [c for c in chunks_of(path) if c.entity_path == f"/{entity}" and not c.is_static]
    return pl.concat([pl.DataFrame(pl.from_arrow(c.to_record_batch())) for c in found])


# -- the schema -----------------------------------------------------------------------------------


def test_state_is_float64_on_an_integer_step(standard: Run) -> None:
    rows = table(standard.simulation.recording, "state")
    assert rows.schema["sim_step"] == pl.Int64
    assert rows["sim_step"].to_list() == list(range(241))
    widths = {"body": 1, "position_m": 3, "orientation": 4, "velocity_m_s": 3, "spin_rad_s": 3}
    for component, width in widths.items():
        whole = component == "body"
        assert rows.schema[component] == pl.List(pl.Int64 if whole else pl.Float64)
        assert set(rows[component].list.len()) == {width}
    assert rows["body"].explode().unique().to_list() == [0]


def test_only_steps_with_contact_points_have_contacts(standard: Run) -> None:
    rows = table(standard.simulation.recording, "contacts")
    assert rows["sim_step"].to_list() == list(range(109, 241))
    points = rows["distance_m"].list.len()
    assert points[0] == 4
    for component in schema.CONTACTS.components:
        whole = component.startswith(("body", "link"))
        assert rows.schema[component] == pl.List(pl.Int64 if whole else pl.Float64)
        assert rows[component].list.len().equals(points * len(columns_of(component)))


def test_a_recording_without_contact_has_no_contacts(tmp_path: Path) -> None:
    simulate(Scenario(floor=False, duration_s=0.1), tmp_path / "run.rrd", camera=None)
    assert "/contacts" not in {chunk.entity_path for chunk in chunks_of(tmp_path / "run.rrd")}
    contacts = read(tmp_path / "run.rrd").contacts
    assert len(contacts) == 0
    assert contacts.schema["body_a"] == pl.Int64
    assert contacts.schema["normal_force_n"] == pl.Float64


def test_a_table_has_the_components_of_its_rows() -> None:
    for one in schema.TABLES.values():
        assert one.kind.names == ("step", *one.components)
        for component in one.components:
            assert len(columns_of(component)) == int(np.prod(one.kind[component].shape))


def test_each_link_of_a_body_with_joints_is_a_part(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    simulate(Scenario(body="r2d2.urdf", duration_s=0.1), path, camera=None)
    recording = read(path)
    links = list(range(-1, recording.engine.joints))
    assert recording.states["link"].to_list() == links * 25
    with World(Scenario(body="r2d2.urdf", duration_s=0.1)) as world:
        states = case_of(world, world.samples(25)).seen.states
    read_back = recording.states.sort("link", "step").select("x_m", "y_m", "z_m").to_numpy()
    assert np.array_equal(states["position_m"], read_back)
    assert recording.states["step"].to_list() == [step for step in range(25) for _ in links]


@pytest.mark.parametrize("batch", [7, 240])
def test_batches_of_any_size_are_the_same_recording(
    tmp_path: Path, standard: Run, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    monkeypatch.setattr("drop_physics.stages.simulate.BATCH", batch)
    simulate(Scenario(), tmp_path / "run.rrd", camera=None)
    mine, theirs = read(tmp_path / "run.rrd"), read(standard.simulation.recording)
    assert mine.states.equals(theirs.states)
    assert mine.contacts.equals(theirs.contacts)


def test_timelines_are_step_time_and_call(standard: Run) -> None:
    found = {name for c in chunks_of(standard.simulation.recording) for name in c.timeline_names}
    assert found == {"sim_step", "sim_time", "call"}
    rows = table(standard.simulation.recording, "state")
    assert rows["sim_time"].dtype == pl.Duration("ns")
    assert rows["sim_time"].cast(pl.Int64)[240] == 1_000_000_000


def test_theory_stops_at_the_floor_and_stays(standard: Run) -> None:
    for entity in (schema.HEIGHT_FREE_FALL, schema.HEIGHT_DAMPED_FALL):
        heights_m = table(standard.simulation.recording, entity)["Scalars:scalars"].explode()
        assert heights_m.dtype == pl.Float64
        assert heights_m[0] == 1.0
        assert heights_m.min() == 0.025
        assert heights_m[-1] == 0.025


def test_the_pose_to_look_at_is_the_state_rounded_to_float32(standard: Run) -> None:
    poses = table(standard.simulation.recording, f"{schema.BOX}/base")
    states = table(standard.simulation.recording, "state")
    shown = np.array([row[0] for row in poses["Transform3D:translation"].to_list()])
    measured = np.array(states["position_m"].to_list())
    steps = poses["sim_step"].to_numpy()
    assert np.array_equal(shown, measured[steps].astype(np.float32))
    # A pose is shown until the next one, and where none is the box has not visibly moved.
    assert np.array_equal(steps[:109], np.arange(109))
    until = steps[np.searchsorted(steps, np.arange(241), side="right") - 1]
    assert np.abs(measured - measured[until]).max() < schema.POSE_RESOLUTION


def test_frames_are_png_every_six_steps_seen_through_a_pinhole(standard: Run) -> None:
    images = table(standard.simulation.recording, schema.IMAGE)
    assert images["sim_step"].to_list() == list(range(0, 241, 6))
    assert set(images["EncodedImage:media_type"].explode()) == {"image/png"}
    static = [c for c in chunks_of(standard.simulation.recording) if c.is_static]
    camera = {
        name
        for c in static
        if c.entity_path == f"/{schema.CAMERA}"
        for name in c.to_record_batch().schema.names
    }
    assert {"Pinhole:image_from_camera", "Pinhole:resolution", "Transform3D:translation"} <= camera


def test_the_pinhole_sees_what_pybullets_camera_saw(standard: Run) -> None:
    """The released box's centre, projected by the pinhole camera, has the box's colour there."""
    import io

    from drop_physics.engines.pybullet.visible_world import world_from_camera
    from drop_physics.recording.frames import frames
    from PIL import Image

    recording = read(standard.simulation.recording)
    camera = recording.camera
    assert camera is not None
    _, png = next(iter(frames(recording)))
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    x, y, z, _ = np.linalg.inv(world_from_camera(camera)) @ [0, 0, 1, 1]
    column = camera.size_px[0] / 2 + camera.focal_length_px * x / -z
    row = camera.size_px[1] / 2 - camera.focal_length_px * y / -z
    background = pixels[0, 0]
    box_rows, box_columns = np.nonzero((pixels[:180] != background).any(axis=2))
    near = (abs(box_rows - row) < 12) & (abs(box_columns - column) < 12)
    assert near.any()
    assert abs(box_rows[near].mean() - row) < 1.5
    assert abs(box_columns[near].mean() - column) < 1.5


def test_properties_hold_every_input_and_what_the_engine_reports(standard: Run) -> None:
    recording = read(standard.simulation.recording)
    assert recording.scenario == Scenario()
    engine = recording.engine
    assert engine.gravity_m_s2 == (0.0, 0.0, -9.81)
    assert engine.timestep_s == 1 / 240
    assert engine.mass_kg == 0.1
    assert engine.inertia_kg_m2 == (0.000125,) * 3
    assert engine.pybullet_version == "3.2.7"
    for name in ("pybullet_wheel", "numpy_version", "rerun_version", "drop_version"):
        assert getattr(engine, name)


def test_about_says_what_it_is(standard: Run) -> None:
    (about,) = [c for c in chunks_of(standard.simulation.recording) if c.entity_path == "/about"]
    text = about.to_record_batch().column("TextDocument:text")[0].as_py()[0]
    assert "cube_small.urdf" in text
    assert "0.1 kg" in text


def test_reruns_own_verification_passes(standard: Run) -> None:
    for path in (standard.simulation.recording, standard.analysis.layer):
        assert "1 file verified" in rerun_rrd("verify", path)


def test_the_layer_carries_the_recordings_id(standard: Run) -> None:
    assert standard.analysis.layer is not None
    (layer,) = RrdReader(standard.analysis.layer).recordings()
    assert layer.recording_id == standard.simulation.recording_id
    found = {c.entity_path for c in chunks_of(standard.analysis.layer)}
    terms = {f"/error/{term}" for term in ("total", *TERMS)}
    assert terms | {"/events", "/findings", "/energy/potential"} <= found


# -- whole or not there ---------------------------------------------------------------------------


def test_a_failing_run_leaves_the_part_and_no_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> object:
        raise RuntimeError("the camera fell over")

    monkeypatch.setattr("drop_physics.engines.pybullet.camera_frames.Photographer.draw", broken)
    with pytest.raises(RuntimeError, match="fell over"):
        simulate(Scenario(), tmp_path / "run.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd.part"]
    partial = read(tmp_path / "run.rrd.part")
    assert partial.partial
    assert len(partial.states) == 241


def test_an_existing_recording_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"precious")
    with pytest.raises(OutputError, match="force=True"):
        simulate(Scenario(), path, camera=None)
    assert path.read_bytes() == b"precious"
    simulate(Scenario(), path, camera=None, force=True)
    assert read(path).scenario == Scenario()
    assert [one.name for one in tmp_path.iterdir()] == ["run.rrd"]


def test_a_recording_that_appears_meanwhile_is_kept(tmp_path: Path) -> None:
    part, path = tmp_path / "run.rrd.part", tmp_path / "run.rrd"
    part.write_bytes(b"new")
    path.write_bytes(b"precious")
    with pytest.raises(OutputError, match="created by another process"):
        renamed(part, path, force=False)
    assert path.read_bytes() == b"precious"


def test_two_writers_of_one_file_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    with sealing.unfinished(path, force=False), pytest.raises(OutputError, match="another process"):
        simulate(Scenario(), path, camera=None)


def test_rows_that_went_missing_are_noticed_before_the_name_is_given(
    tmp_path: Path, standard: Run
) -> None:
    part, path = tmp_path / "run.rrd.part", tmp_path / "run.rrd"
    part.write_bytes(standard.simulation.recording.read_bytes())
    with pytest.raises(OutputError, match="does not verify"):
        sealing.seal(part, path, blueprint=None, rows={"/state": 242}, force=False)
    assert not path.exists()


def test_a_stretch_lost_on_the_disk_is_noticed_before_the_name_is_given(
    tmp_path: Path, standard: Run
) -> None:
    part, path = tmp_path / "run.rrd.part", tmp_path / "run.rrd"
    data = bytearray(standard.simulation.recording.read_bytes())
    data[4096:8192] = bytes(4096)
    part.write_bytes(data)
    rows: dict[str, int] = {}
    for chunk in chunks_of(standard.simulation.recording):
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    with pytest.raises(OutputError, match="does not verify"):
        sealing.seal(part, path, blueprint=None, rows=rows, force=False)
    assert not path.exists()


def test_the_layout_of_both_arrives_last_in_whatever_way_two_files_load(standard: Run) -> None:
    """The viewer loads files at once, and keeps the layout that arrives last."""
    assert standard.analysis.layer is not None
    recording = kinds_in(standard.simulation.recording)
    layer = kinds_in(standard.analysis.layer)
    assert recording.count(rrd.ACTIVATION) == layer.count(rrd.ACTIVATION) == 1
    assert recording.index(rrd.ACTIVATION) < len(recording) / 2
    assert layer[-1] == rrd.ACTIVATION


def kinds_in(path: Path) -> list[int]:
    """Return the kinds of messages in a Rerun file, in their order."""
    with path.open("rb") as file:
        return [kind for kind, _, _ in rrd._messages(file, unfinished=False)]


# -- reading back ---------------------------------------------------------------------------------


def rewritten(source: Path, path: Path, change: object, *, application_id: str = "drop") -> Path:
    """Write a recording with each chunk replaced by a function's result; None leaves it out."""
    assert callable(change)
    chunks = [one for c in chunks_of(source) if (one := change(c)) is not None]
    LazyChunkStream.from_iter(chunks).write_rrd(
        path, application_id=application_id, recording_id="rewritten"
    )
    return path


@pytest.mark.parametrize(
    ("entity", "component", "said"),
    [
        ("/state", "spin_rad_s", "its section state fails its checksum"),
        ("/contacts", "friction_2_direction", "its section contacts fails its checksum"),
    ],
)
def test_a_bit_changed_in_state_or_contacts_is_noticed(
    tmp_path: Path, standard: Run, entity: str, component: str, said: str
) -> None:
    def nudge(chunk: Chunk) -> Chunk:
        if chunk.entity_path != entity:
            return chunk
        import pyarrow as pa

        batch = chunk.to_record_batch()
        index = batch.schema.get_field_index(component)
        rows = batch.column(index).to_pylist()
        rows[7][1] = float(np.nextafter(rows[7][1], 1))
        changed = pa.array(rows, type=batch.schema.field(index).type)
        (one,) = Chunk.from_record_batch(
            batch.set_column(index, batch.schema.field(index), changed)
        )
        return one

    path = rewritten(standard.simulation.recording, tmp_path / "nudged.rrd", nudge)
    with pytest.raises(RecordingError, match=said):
        read(path)


def test_without_a_change_the_rewritten_recording_reads_the_same(
    tmp_path: Path, standard: Run
) -> None:
    path = rewritten(standard.simulation.recording, tmp_path / "same.rrd", lambda chunk: chunk)
    mine, theirs = read(path), read(standard.simulation.recording)
    assert mine.states.equals(theirs.states)
    assert mine.contacts.equals(theirs.contacts)


@pytest.mark.parametrize("entity", ["/state", "/contacts", "/__properties/scenario"])
def test_a_missing_part_is_named(tmp_path: Path, standard: Run, entity: str) -> None:
    path = rewritten(
        standard.simulation.recording,
        tmp_path / "less.rrd",
        lambda chunk: None if chunk.entity_path == entity else chunk,
    )
    with pytest.raises(RecordingError, match=entity.rsplit("/", maxsplit=1)[-1]):
        read(path)


def test_a_recording_of_another_application_is_refused(tmp_path: Path, standard: Run) -> None:
    path = rewritten(
        standard.simulation.recording, tmp_path / "x.rrd", lambda c: c, application_id="other"
    )
    with pytest.raises(RecordingError, match="'other'"):
        read(path)


def test_a_recording_of_the_first_schema_is_to_be_made_again(tmp_path: Path, standard: Run) -> None:
    import pyarrow as pa

    def older(chunk: Chunk) -> Chunk | None:
        if chunk.entity_path in ("/state", "/contacts"):
            return None
        if chunk.entity_path != "/__properties/recording":
            return chunk
        batch = chunk.to_record_batch()
        index = batch.schema.get_field_index("schema_version")
        (one,) = Chunk.from_record_batch(
            batch.set_column(index, batch.schema.field(index), pa.array([[1]]))
        )
        return one

    path = rewritten(standard.simulation.recording, tmp_path / "old.rrd", older)
    with pytest.raises(RecordingError) as raised:
        read(path)
    again = "record it again with: drop simulate"
    assert str(raised.value) == f"{path} was made by an earlier version of drop; {again}"


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="/proc is missing")
def test_writing_leaves_no_thread_behind(tmp_path: Path) -> None:
    """Rerun keeps the threads of a layout that it saved, which wake up continuously."""

    def threads_after_a_recording() -> int:
        simulate(Scenario(duration_s=0.1), tmp_path / "run.rrd", camera=None, force=True)
        return len(list(Path("/proc/self/task").iterdir()))

    first = threads_after_a_recording()
    assert [threads_after_a_recording() for _ in range(3)] == [first] * 3

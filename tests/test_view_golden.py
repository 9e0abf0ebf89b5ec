"""A recording and a golden one shown together, at the first difference."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import Drop
from drop_physics import Scenario, colours, simulate
from drop_physics.recording import viewer as program
from drop_physics.recording.reader import recording_id as read_id
from drop_physics.stages.view import view
from rerun.chunk import RrdReader
from test_check import Record, golden, recording
from viewer import Viewer, vulkan_driver

__all__ = ["golden", "recording"]


def test_bodies_and_heights_of_the_golden_one_are_added_in_grey(
    recording: Record, golden: Path
) -> None:
    changed = recording(("[0, 0, 0.2]", "[0, 0, 0.25]"))
    with view([changed], against=golden, web=True) as shown:
        (layer,) = [
            Path(argument) for argument in shown.viewer.command if argument.endswith("golden.rrd")
        ]
        assert (shown.same, shown.first_difference) == (False, 0)
        added = {chunk.entity_path: chunk.to_record_batch() for chunk in RrdReader(layer).stream()}
        assert read_id(layer) == read_id(changed)
    assert not layer.exists()
    tops = {"/".join(entity.split("/")[:4]) for entity in added}
    assert tops == {"/world/golden/1_sphere", "/world/golden/2_arm", "/height/golden/1_sphere"}
    colours_seen = added["/world/golden/1_sphere/base/0"].column("Ellipsoids3D:colors").to_pylist()
    assert colours_seen == [[0xC3C8CF60]]
    positions = added["/world/golden/1_sphere/base"].column("Transform3D:translation")
    of_golden = [
        chunk.to_record_batch().column("Transform3D:translation")
        for chunk in RrdReader(golden).stream()
        if chunk.entity_path == "/world/1_sphere/base"
    ]
    assert [positions] == of_golden


def test_two_recordings_of_one_script_are_seen_together(
    recording: Record, golden: Path, drop: Drop, tmp_path: Path
) -> None:
    changed = recording(("[0, 0, 0.2]", "[0, 0, 0.25]"))
    with view([changed, golden], web=True) as shown:
        assert (shown.recordings, shown.golden) == ([changed], golden)
        assert shown.first_difference == 0
    (tmp_path / "other.py").write_text(
        "import pybullet as p\np.connect(p.DIRECT)\np.stepSimulation()"
    )
    drop("record", "other.py")
    other = tmp_path / "recordings/other.rrd"
    with view([changed, other], web=True) as shown:
        assert (shown.recordings, shown.golden) == ([changed, other], None)


def test_a_drop_and_its_golden_one_are_seen_together(tmp_path: Path) -> None:
    simulate(Scenario(duration_s=0.1), tmp_path / "run.rrd", camera=None)
    undamped = tmp_path / "undamped.rrd"
    simulate(Scenario(duration_s=0.1, linear_damping=0.0), undamped, camera=None)
    with view([undamped], against=tmp_path / "run.rrd", web=True) as shown:
        added = {chunk.entity_path for chunk in RrdReader(Path(shown.viewer.command[2])).stream()}
        assert (shown.same, shown.first_difference) == (False, 2)
    assert added == {"/world/golden/base", "/world/golden/base/0", "/height/golden"}


@pytest.mark.long
@pytest.mark.skipif(vulkan_driver() is None, reason="no software Vulkan")
def test_both_open_as_one_recording_at_the_first_difference(
    recording: Record, golden: Path
) -> None:
    changed = recording(("[0.5, 0, 0]", "[0.7, 0, 0]"))
    with view([changed], against=golden, web=True) as shown:
        layer = next(
            Path(argument) for argument in shown.viewer.command if argument.endswith("golden.rrd")
        )
        with Viewer(changed, layer) as viewer:
            port = int(viewer.url.split(":")[2].split("/")[0])
            assert shown.first_difference == 22
            program.put_cursor(program.Viewer([], port, None), 0.3, viewer.process, step=22)
            state = viewer.client.get_state()
            (opened,) = state.recordings
            assert (opened.current_timeline, opened.current_time) == ("sim_step", 22)
            assert viewer.shows("Heights of free bodies [m]", colours.GOLDEN)
            assert viewer.warnings() == []


def test_several_recordings_have_no_golden_one(golden: Path, drop: Drop) -> None:
    done = drop("view", golden, golden, "--against", golden)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)

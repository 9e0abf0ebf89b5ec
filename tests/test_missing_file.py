"""A file that a script cannot load: the message says where it is."""

from __future__ import annotations

from pathlib import Path

import pytest
from drop_physics.stages.record import record_script
from drop_physics.stages.record.missing_file import missing_file

pytestmark = pytest.mark.pybullet

ROBOT = '<robot name="b"><link name="b"/></robot>'
MESH = '<robot name="b"><link name="b"><collision><geometry><mesh filename="meshes/{}"/>'


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("'plane.urdf', [0, 0, {}]", "plane.urdf is in pybullet_data: call p.setAdditional"),
        ("fileName='kuka_iiwa/Model.urdf'", "Model.urdf, but there is kuka_iiwa/model.urdf"),
        ("'mine.urdf'", "but is looked for in the working directory: give sub/mine"),
        ("'mime.urdf'", "There is no mime.urdf, but there is mine.urdf"),
        ("'mesh.urdf'", "mesh.urdf exists, but meshes/lost.stl, which it names, does not"),
        ("'nowhere.urdf'", "There is no nowhere.urdf in the working directory, beside the"),
    ],
)
def test_where_a_file_is(
    arguments: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/mine.urdf").write_text(ROBOT)
    (tmp_path / "mesh.urdf").write_text(MESH.format("lost.stl"))
    assert words in str(missing_file(arguments, "sub/script.py"))


def test_a_file_with_all_its_meshes_and_no_name_at_all_say_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/there.stl").write_text("")
    (tmp_path / "broken.urdf").write_text(MESH.format("there.stl"))
    assert missing_file("'broken.urdf'", "script.py") is None
    assert missing_file("{}", "script.py") is None


def test_a_recording_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    script = "import pybullet as p\np.connect(p.DIRECT)\np.loadURDF('plane.urdf')\n"
    Path("script.py").write_text(script)
    recorded = record_script("script.py", out="out.rrd")
    assert recorded.error.startswith("pybullet.error: Cannot load URDF file. plane.urdf is in")

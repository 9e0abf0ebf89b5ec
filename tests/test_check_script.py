"""Comparison with a golden recording of a script: the first difference is found, and its cause.

Each script is recorded once for all tests; differences that no script can cause here, such as
another engine, are made in the data read back.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
import pytest
import scenes
import scripts
from conftest import Drop
from jsonschema import Draft202012Validator
from rerun.chunk import Chunk, LazyChunkStream, RrdReader
from test_references import schema_of, strict
from viewer import Viewer, has_colour, vulkan_driver

from pipeline import Scenario, colours, simulate
from pipeline.analysis.script.cause import Side
from pipeline.analysis.script.comparison import ScriptComparison, compare_scripts
from pipeline.analysis.script.difference import Difference
from pipeline.analysis.script.input_differences import input_differences
from pipeline.analysis.script.sample_differences import allowed, first_contact, first_state, paired
from pipeline.errors import OutputError, RecordingError
from pipeline.recording import schema
from pipeline.recording import viewer as program
from pipeline.recording.reader import recording_id as read_id
from pipeline.recording.script_reader import read_script
from pipeline.stages.check_script import check_script
from pipeline.stages.record import record_script
from pipeline.stages.view_golden import with_golden

BOX = """
import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 0.2])
p.changeDynamics(ball, -1, linearDamping=0)
arm = p.loadURDF("arm.urdf", useFixedBase=True)
for step in range(60):
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, targetVelocity=1, force=5)
    p.stepSimulation()
    if step == 20:
        p.resetBaseVelocity(ball, [0.5, 0, 0])
p.getCameraImage(16, 16, p.computeViewMatrix([1, 1, 1], [0, 0, 0], [0, 0, 1]),
                 p.computeProjectionMatrixFOV(60, 1, 0.1, 10))
"""
ARM = """<robot name="arm"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 0.2"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/>
<origin xyz="2 0 1"/><axis xyz="0 1 0"/></joint></robot>"""

Record = Callable[..., Path]


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """Return a function that records `BOX` with changes as `sim.py`, once for each change."""
    folder = tmp_path_factory.mktemp("scripts")

    @cache
    def record(*changes: tuple[str, str], mass: float = 1.0, run: int = 0, **how: Any) -> Path:
        text = BOX
        for before, after in changes:
            assert before in text, before
            text = text.replace(before, after)
        out = folder / f"{len(list(folder.iterdir()))}-{run}.rrd"
        work = folder / out.stem
        work.mkdir()
        work.joinpath("sim.py").write_text(text)
        work.joinpath("arm.urdf").write_text(ARM.format(mass=mass))
        back = Path.cwd()
        os.chdir(work)
        try:
            record_script("sim.py", out=out, **how)
        finally:
            os.chdir(back)
        return out

    return record


@pytest.fixture(scope="session")
def golden(recording: Record) -> Path:
    return recording()


def compared(path: Path, golden: Path, **how: Any) -> ScriptComparison:
    result = check_script(path, golden, **how).comparison
    assert result is not None
    return result


def side(path: Path) -> Side:
    read_back = read_script(path)
    return Side(read_back.origin, read_back.ended or {}, read_back.seen)


# -- the command ----------------------------------------------------------------------------------


def test_the_same_script_recorded_twice_is_the_same_to_the_bit(
    recording: Record, golden: Path, drop: Drop
) -> None:
    done = drop("check", recording(run=1), "--against", golden, "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, done.stderr) == (0, "")
    assert result["same"] is True
    assert result["largest_difference_m"] == 0.0
    assert result["frames"] == {"compared": 1, "differing": 0, "first_step": None, "why": None}
    for key in ("first_difference", "looks_like", "cause", "call_before", "other_call"):
        assert result[key] is None
    output = drop("check", recording(run=1), "--against", golden).stdout
    assert "positions   identical\n" in output


def test_another_constant_exits_3_and_is_named_by_step_body_and_column(
    recording: Record, golden: Path, drop: Drop
) -> None:
    changed = recording(("[0, 0, 0.2]", "[0, 0, 0.25]"))
    done = drop("check", changed, "--against", golden, "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 3
    assert result["first_difference"] == {
        "step": 0, "body": "1_sphere", "link": -1, "column": "z_m", "value": 0.25, "golden": 0.2,
        "difference": pytest.approx(0.05),
    }  # fmt: skip
    assert result["other_call"]["value"]["arguments"].endswith("[0, 0, 0.25]")
    assert result["other_call"]["golden"]["arguments"].endswith("[0, 0, 0.2]")
    assert result["other_call"]["value"]["line"] == 6
    assert result["cause"] == "another script: its text and its calls differ"
    assert result["looks_like"].startswith("1_sphere is 50 mm off at step 0, ")
    schema_of_it = strict(schema_of("check"))
    assert not list(Draft202012Validator(schema_of_it).iter_errors(result))
    output = drop("check", changed, "--against", golden).stdout
    assert "first       step 0, 1_sphere, z_m: 0.25, golden 0.2 (+0.05)\n" in output
    assert "call        " in output


def test_a_script_and_a_drop_are_not_compared(golden: Path, drop: Drop, tmp_path: Path) -> None:
    simulate(Scenario(duration_s=0.1), tmp_path / "drop.rrd", camera=None)
    for run, against in ((golden, "drop.rrd"), ("drop.rrd", golden)):
        done = drop("check", run, "--against", against)
        assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
        assert "must be the recording of a" in done.stderr
        done = drop("check", run, "--against", against, "--update")
        assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert read_script(golden).ended is not None


def test_missing_files_unfinished_ones_and_bad_tolerances_are_one_line(
    golden: Path, drop: Drop, tmp_path: Path
) -> None:
    done = drop("check", golden, "--against", "no.rrd")
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert done.stderr.endswith("--against no.rrd --update\n")
    closing = f"__properties/{schema.RECORDING_PROPERTY}"
    rewritten(golden, tmp_path / "run.rrd.part", closing, lambda _: [])
    done = drop("check", "run.rrd.part", "--against", golden)
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert "never finished" in done.stderr
    done = drop("check", golden, "--against", golden, "--tolerance", "nan")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


def test_update_makes_it_the_golden_recording(
    recording: Record, golden: Path, drop: Drop, tmp_path: Path
) -> None:
    assert drop("check", golden, "--against", "new.rrd", "--update").returncode == 0
    assert check_script(golden, tmp_path / "new.rrd").same
    changed = recording(("-9.81", "-1.6"))
    done = drop("check", changed, "--against", "new.rrd", "--update", "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, result["same"], result["updated"]) == (0, False, True)
    assert check_script(changed, tmp_path / "new.rrd").same
    tmp_path.joinpath("text.rrd").write_text("not a recording")
    with pytest.raises(OutputError, match=r"text\.rrd is not a recording of a script"):
        check_script(golden, tmp_path / "text.rrd", update=True)


# -- what differs first ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "first"),
    [
        (("-9.81", "-1.6"), Difference(0, None, None, "engine.gravityAccelerationZ", -1.6, -9.81)),
        (
            ("linearDamping=0)", "linearDamping=0.1)"),
            Difference(0, "1_sphere", None, "dynamics/given.linearDamping", 0.1, 0.0),
        ),
        (
            ("p.createMultiBody(1,", "p.createMultiBody(2,"),
            Difference(0, "1_sphere", -1, "dynamics.mass_kg", 2.0, 1.0),
        ),
        (("[0.5, 0, 0]", "[0.7, 0, 0]"), Difference(
            21, "1_sphere", -1, "set.velocity_m_s.0", 0.7, 0.5)),
        (("force=5", "force=6"), Difference(0, "2_arm", None, "motors.force", 6.0, 5.0)),
        (
            ("    p.stepSimulation()", "    if step == 7:\n"
             "        p.applyExternalForce(ball, -1, [1, 0, 0], [0, 0, 0], p.LINK_FRAME)\n"
             "    p.stepSimulation()"),
            Difference(7, "1_sphere", None, "pushes.rows", 1, 0),
        ),
        (("range(60)", "range(50)"), Difference(51, "1_sphere", -1, "there", 0.0, 1.0)),
    ],
)  # fmt: skip
def test_other_inputs_are_named(
    recording: Record, golden: Path, change: tuple[str, str], first: Difference
) -> None:
    result = compared(recording(change), golden)
    assert result.first == first
    assert not result.same


def test_inputs_after_the_samples_differ_are_not_the_cause(recording: Record, golden: Path) -> None:
    """A script that pushes harder the farther it is off: only the first cause is reported."""
    steering = (
        "    p.stepSimulation()",
        "    z = p.getBasePositionAndOrientation(ball)[0][2]\n"
        "    p.applyExternalForce(ball, -1, [0, 0, 0.3 - z], [0, 0, 0], p.LINK_FRAME)\n"
        "    p.stepSimulation()",
    )
    result = compared(recording(steering, ("-9.81", "-9.8")), recording(steering))
    assert [difference.column for difference in result.differences] == [
        "engine.gravityAccelerationZ"
    ]
    assert result.samples_part_at == 1
    assert not compared(recording(steering), golden).same


def test_a_body_that_is_missing_or_more(recording: Record, golden: Path) -> None:
    without = (
        ("arm = p.loadURDF", "arm = 0  #"),
        ("    p.setJointMotorControl2", "    0  #"),
    )
    result = compared(recording(*without), golden)
    assert result.first == Difference(0, "2_arm", None, "there", 0.0, 1.0)
    assert result.largest_difference_m == 0.0
    assert result.looks_like == "every state that both have is identical"
    assert result.other_call is not None
    assert result.other_call.golden is not None
    assert result.other_call.golden.function == "loadURDF"
    more = compared(golden, recording(*without))
    assert more.first == Difference(0, "2_arm", None, "there", 1.0, 0.0)


def test_differences_are_always_listed_in_the_same_order(recording: Record, golden: Path) -> None:
    more = "".join(
        f"p.createMultiBody(1, basePosition=[{number}, 5, 9], baseVisualShapeIndex=-1)\n"
        for number in range(9)
    )
    path = recording(("arm = ", f"{more}arm = "))
    seen = read_script(path).seen
    theirs = read_script(golden).seen
    missing = input_differences(seen, theirs)
    labels = [difference.body for _, difference in missing if difference.value == 1.0]
    assert labels == sorted(labels)
    assert len(labels) > 9
    assert list(paired(seen, seen).bodies) == list(seen.bodies)


def test_the_calls_before_it_and_the_other_call_are_reported(
    recording: Record, golden: Path
) -> None:
    result = compared(recording(("[0.5, 0, 0]", "[0.7, 0, 0]")), golden)
    assert result.call_before is not None
    assert result.call_before.at.step == 21
    assert result.other_call is not None
    assert result.other_call.value is not None
    assert result.other_call.value.function == "resetBaseVelocity"
    assert (result.other_call.value.at.step, result.other_call.value.line) == (21, 13)
    assert result.other_call.value.arguments == "1, [0.7, 0, 0]"


def test_an_altered_number_of_a_state_is_found_and_what_it_looks_like(golden: Path) -> None:
    theirs = side(golden)
    at = (pl.col("body") == 1) & (pl.col("step") >= 30)
    states = theirs.seen.states.with_columns(
        x_m=pl.when(at).then(pl.col("x_m") + 0.001 * (pl.col("step") - 29)).otherwise("x_m")
    )
    mine = replace(theirs, seen=replace(theirs.seen, states=states))
    result = compare_scripts(mine, theirs)
    assert result.first is not None
    assert (result.first.step, result.first.body, result.first.link) == (30, "1_sphere", -1)
    assert result.first.difference == pytest.approx(1e-3)
    assert result.looks_like == ("1_sphere is 1 mm off at step 30, 31 mm off at the end (step 60)")
    assert result.largest_difference_m == pytest.approx(0.031)
    assert result.call_before is not None
    assert (result.call_before.function, result.call_before.at.step) == (
        "setJointMotorControl2",
        29,
    )
    assert compare_scripts(mine, theirs, tolerance_m=0.032).same
    assert not compare_scripts(mine, theirs, tolerance_m=0.030).same


def test_what_only_turns_is_in_the_same_place(golden: Path) -> None:
    theirs = side(golden)
    at = (pl.col("body") == 1) & (pl.col("step") == 30)
    states = theirs.seen.states.with_columns(
        wy_rad_s=pl.when(at).then(pl.col("wy_rad_s") + 1).otherwise("wy_rad_s")
    )
    mine = replace(theirs, seen=replace(theirs.seen, states=states))
    result = compare_scripts(mine, theirs)
    assert result.first is not None
    assert result.first.column == "wy_rad_s"
    assert result.looks_like == (
        "1_sphere moves differently from step 30 on, in the same place at the end (step 60)"
    )


def test_recordings_are_compared_up_to_the_end_of_the_shorter(
    recording: Record, golden: Path, drop: Drop
) -> None:
    pushed = (
        "    p.stepSimulation()",
        "    p.applyExternalForce(ball, -1, [0, 0, 1], [0, 0, 0], p.LINK_FRAME)\n"
        "    p.stepSimulation()",
    )
    assert compared(recording(pushed, steps=50), recording(pushed)).differences == []
    removing = (
        ("if step == 20:", "if step == 59: p.removeBody(1), p.removeBody(2)\n    if step == 20:"),
        ("range(60)", "range(70)"), ("    p.setJoint", "    step > 59 or p.setJoint"),
    )  # fmt: skip
    not_removing = (("range(60)", "range(70)"), removing[2])
    result = compared(recording(*removing), recording(*not_removing))
    assert result.cause == "another script: its text and its calls differ"
    assert {difference.column for difference in result.differences} == {"bodies.rows"}
    result = compared(recording(steps=50), golden)
    assert result.first == Difference(51, "1_sphere", -1, "there", 0.0, 1.0)
    assert result.cause == (
        "the same calls as far as both go: it ended after step 50 (steps), golden after step 60 "
        "(finished)"
    )
    done = drop("check", recording(steps=50), "--against", golden)
    assert "positions   identical, as far as both go\n" in done.stdout
    assert done.returncode == 3


def test_joints_and_contact_points_are_compared_to_the_bit(golden: Path) -> None:
    theirs = side(golden)
    joints = theirs.seen.joints[2]
    torque = joints.torque.copy()
    torque[40] = np.nextafter(torque[40], np.inf)
    other = replace(theirs.seen, joints={2: replace(joints, torque=torque)})
    first = compare_scripts(replace(theirs, seen=other), theirs).first
    assert first is not None
    assert (first.step, first.body, first.link, first.column) == (40, "2_arm", 0, "joint_torque")
    contacts = theirs.seen.contacts
    assert len(contacts) > 5
    step = contacts["step"][4]
    fewer = replace(theirs.seen, contacts=contacts.with_row_index().filter(
        pl.col("index") != 4).drop("index"))  # fmt: skip
    first = compare_scripts(replace(theirs, seen=fewer), theirs).first
    assert first is not None
    assert (first.step, first.column, first.difference) == (step, "contact_points", -1.0)


def test_an_image_that_differs(recording: Record, golden: Path, drop: Drop) -> None:
    result = check_script(recording(("[1, 1, 1], [0", "[1, 1, 2], [0")), golden)
    assert result.first == Difference(60, None, None, "frame")
    assert result.frames is not None
    assert (result.frames.compared, result.frames.differing) == (1, 1)
    assert result.comparison is not None
    assert result.comparison.looks_like == "every state that both have is identical"
    assert result.comparison.cause == (
        "another text of the script, but the same calls, other images: another camera, which does "
        "not count as a call, or a file that is drawn has changed"
    )
    output = drop("check", result.recording, "--against", golden).stdout
    assert "cause       another text of the script" in output


def test_an_image_that_one_lacks_is_called_that(recording: Record) -> None:
    """Those after it are the same."""
    taking = (
        ("import pybullet as p", "import sys, pybullet as p"),
        (
            "    p.stepSimulation()\n",
            "    p.stepSimulation()\n    if str(step) in sys.argv: p.getCameraImage(16, 16)\n",
        ),
    )
    run, golden = (
        recording(*taking, arguments=steps) for steps in (("9", "39"), ("9", "29", "39"))
    )
    result = check_script(run, golden)
    assert result.first == Difference(30, None, None, "frame")
    assert result.frames is not None
    assert (result.frames.compared, result.frames.differing) == (4, 1)
    assert result.comparison is not None
    assert result.comparison.cause == (
        "the same calls, but at step 30 only one of them took an image, which does not count as a "
        "call"
    )


def test_a_picture_before_the_scene_is_complete_is_no_other_physics(recording: Record) -> None:
    """What comes after it has no sample of where it began."""
    looking = (
        ("import pybullet as p", "import sys, pybullet as p"),
        ("arm = p.load", "if 'look' in sys.argv: p.getCameraImage(16, 16)\narm = p.load"),
    )
    for how in ((("look",), ()), ((), ("look",))):
        result = check_script(*(recording(*looking, arguments=each) for each in how))
        assert result.first == Difference(0, None, None, "frame")
        assert result.comparison is not None
        assert result.comparison.looks_like == "every state that both have is identical"


def test_connecting_again_is_not_ending_later(recording: Record) -> None:
    connecting = (
        ("import pybullet as p", "import sys, pybullet as p"),
        (
            "p.getCameraImage(16, 16",
            "if 'again' in sys.argv: p.disconnect(); p.connect(p.DIRECT)\n"
            "p.stepSimulation()\np.getCameraImage(16, 16",
        ),
    )
    result = compared(recording(*connecting, arguments=("again",)), recording(*connecting))
    assert result.cause is not None
    assert "a simulation that begins or ends elsewhere" in result.cause


def test_an_image_that_differs_after_another_call_is_caused_by_it(
    recording: Record, golden: Path
) -> None:
    held = ("p.getCameraImage(16, 16", "p.setGravity(0, 0, -9.81)\np.getCameraImage(16, 15")
    result = check_script(recording(held), golden)
    assert result.first == Difference(60, None, None, "frame")
    assert result.comparison is not None
    assert result.comparison.cause == "another script: its text and its calls differ"


# -- its cause ------------------------------------------------------------------------------------


def test_unseeded_random_numbers_are_the_cause(recording: Record) -> None:
    drawing = (
        ("import pybullet as p", "import pybullet as p, random"),
        ("[0, 0, 0.2]", "[0, 0, random.random()]"),
    )
    result = compared(recording(*drawing, run=1), recording(*drawing, run=2))
    assert result.cause is not None
    assert result.cause.startswith(
        "the same script, other calls: it draws unseeded random numbers, random.random at sim.py:6"
    )
    seeded = [recording(*drawing, run=run, seed=3) for run in range(2)]
    assert compared(*seeded).same


def test_what_differs_need_not_be_the_cause(recording: Record) -> None:
    """A number that is drawn, and an argument, but the height comes from a file."""
    reading = (
        ("import pybullet as p", "import pybullet as p, random, re\nrandom.random()"),
        ("[0, 0, 0.2]", "[0, 0, float(re.findall('[0-9.]+', open('arm.urdf').read())[3])]"),
    )
    reads = "what it reads has changed"
    drawn = [recording(*reading, mass=mass) for mass in (1.0, 2.0)]
    result = compared(*drawn)
    assert result.cause is not None
    assert "random.random at sim.py:3, which --seed 0 fixes, or " + reads in result.cause
    given = [recording(*reading, mass=mass, seed=0, arguments=(f"{mass}",)) for mass in (1.0, 2.0)]
    result = compared(*given)
    assert result.cause is not None
    assert "other calls: arguments 1.0, golden 2.0, or " + reads in result.cause


def test_another_file_that_the_same_calls_load(recording: Record, golden: Path) -> None:
    result = compared(recording(mass=1.1), golden)
    assert result.first == Difference(0, "2_arm", 0, "dynamics.mass_kg", 1.1, 1.0)
    assert result.other_call is None
    assert result.cause is not None
    assert "a file that they load has changed" in result.cause


def test_a_file_that_changed_only_where_pybullet_does_not_report_it(tmp_path: Path) -> None:
    """A vertex of a mesh in the same box: only the motion shows it."""
    text = """
        import pybullet as p
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81)
        p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
        mesh = p.createCollisionShape(p.GEOM_MESH, fileName="{file}")
        p.createMultiBody(1, mesh, basePosition=[0, 0, 0.15], baseOrientation=[0.1, 0.2, 0, 0.97])
        for _ in range(100):
            p.stepSimulation()
        """
    paths = []
    for run, low in enumerate((-0.1, -0.05)):
        corners = [(x, y, z) for z in (low, 0.1) for y in (-0.1, 0.1) for x in (-0.1, 0.1)]
        lines = [f"v {x} {y} {z}" for x, y, z in [*corners, (0.1, 0.1, -0.1)]]
        faces = "f 1 3 2\nf 2 3 4\nf 5 6 7\nf 6 8 7\nf 1 2 9\nf 3 9 4\n"
        file = tmp_path / "shape.obj"
        file.write_text("\n".join(lines) + "\n" + faces)
        paths.append(recorded(text.format(file=file), tmp_path / f"{run}.rrd"))
    result = compared(paths[1], paths[0])
    assert not result.same
    assert result.cause == (
        "the same calls, other numbers, and the same versions: a file that they load has changed, "
        "or another build or processor, or uninitialized memory that PyBullet reads, which drop "
        "record --twice shows"
    )
    unread = replace(side(paths[0]).seen, calls=[])
    other, theirs = (replace(side(path), seen=unread) for path in paths)
    states = unread.states.with_columns(pl.col("vz_m_s") * (1 + 1e-15))
    result = compare_scripts(replace(other, seen=replace(unread, states=states)), theirs)
    assert result.cause is not None
    assert "a file" not in result.cause


BLOCK = """
import pybullet as p
from pipeline import record
def run(out, height, after=0):
    with record(out):
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81)
        p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
        for z in (0, 0.25):
            p.createMultiBody(1, box, -1, [z / 3, 0, height + z], [0.1, 0.2, 0.05, 0.9])
        for _ in range(150):
            p.stepSimulation()
        if after:
            p.setPhysicsEngineParameter(contactBreakingThreshold=after)
        p.disconnect()
run("low.rrd", 0.3)
run("high.rrd", 0.4)
run("sets.rrd", 0.3, 0.0005)
run("after.rrd", 0.3)
"""


def test_blocks_differ_by_their_code_or_by_what_came_before(tmp_path: Path) -> None:
    """Bullet keeps contactBreakingThreshold for the process, and does not report it."""
    subprocess.run([sys.executable, "-c", BLOCK], cwd=tmp_path, check=True, timeout=120)
    result = compared(tmp_path / "high.rrd", tmp_path / "low.rrd")
    assert result.cause == (
        "other calls: the block's code has changed, its seed, or what it reads, such as a file or "
        "the time of day, or what is not the same in every run, such as the order of a set"
    )
    result = compared(tmp_path / "after.rrd", tmp_path / "low.rrd")
    assert result.first is not None
    assert result.cause == (
        "the same calls, other numbers, and the same versions: what the process did before the "
        "block still acts, as contactBreakingThreshold does in every later simulation, or another "
        "build or processor, or uninitialized memory that PyBullet reads"
    )


def test_the_same_calls_and_other_numbers_are_another_engine(golden: Path) -> None:
    theirs = side(golden)
    states = theirs.seen.states.with_columns(pl.col("vz_m_s") * (1 + 1e-15))
    seen = replace(theirs.seen, states=states)
    result = compare_scripts(replace(theirs, seen=seen), theirs)
    assert result.cause is not None
    assert result.cause.startswith("the same calls, other numbers, and the same versions")
    assert "a file that they load has changed, or another build or processor" in result.cause
    upgraded = replace(theirs, seen=seen, ended={**theirs.ended, "made_with_pybullet_api": 1})
    result = compare_scripts(upgraded, theirs)
    assert result.cause is not None
    assert "another engine or machine, made with pybullet_api 1, golden 2" in result.cause
    assert [version.name for version in result.versions] == ["pybullet_api"]


CLOTH = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadSoftBody("cloth_z_up.obj", basePosition=[0, 0, 1.0], scale=0.5, mass=1, useMassSpring=1)
for _ in range(24):
    p.stepSimulation()
"""


def recorded(script: str, path: Path, *arguments: str) -> Path:
    """Record a script that is written beside its recording."""
    source = path.parent / "sim.py"
    source.write_text(textwrap.dedent(script))
    record_script(str(source), list(arguments), out=path)
    return path


def test_soft_bodies_are_not_compared_and_never_the_same(drop: Drop, tmp_path: Path) -> None:
    """PyBullet reports no state of them: only other calls that load them are a difference."""
    cloth = recorded(CLOTH, tmp_path / "cloth.rrd")
    done = drop("check", "cloth.rrd", "--against", "cloth.rrd", "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 3
    assert (result["same"], result["first_difference"]) == (False, None)
    assert result["not_compared"] == ["1_cloth_z_up"]
    schema_of_it = strict(schema_of("check"))
    assert not list(Draft202012Validator(schema_of_it).iter_errors(result))
    output = drop("check", "cloth.rrd", "--against", "cloth.rrd").stdout
    assert output.startswith("undecided   cloth.rrd and cloth.rrd\nleft out    1_cloth_z_up: ")
    assert drop("check", cloth, "--against", "new.rrd", "--update").returncode == 0
    higher = recorded(CLOTH.replace("1.0", "3.0"), tmp_path / "higher.rrd")
    result = compared(higher, cloth)
    assert result.first is not None
    assert (result.first.column, result.first.step) == ("calls.arguments", 0)
    assert "[0, 0, 3.0]" in str(result.first.value)
    assert result.cause == "another script: its text and its calls differ"


def test_simulations_of_other_lengths_differ_even_if_nothing_moves(tmp_path: Path) -> None:
    cloth = recorded(CLOTH, tmp_path / "cloth.rrd")
    longer = recorded(CLOTH.replace("range(24)", "range(30)"), tmp_path / "longer.rrd")
    for tolerance_m in (0.0, 1e-3):
        result = compared(longer, cloth, tolerance_m=tolerance_m)
        assert result.first == Difference(25, None, None, "there", 1.0, 0.0)
        assert result.cause == (
            "another text of the script, but the same calls as far as both go: it ended after "
            "step 30 (finished), golden after step 24 (finished)"
        )


def test_links_that_pybullet_does_not_show_are_not_compared(tmp_path: Path) -> None:
    tmp_path.joinpath("arm.urdf").write_text(ARM.format(mass=1))
    path = recorded(
        f"""
        import pybullet as p
        p.connect(p.DIRECT)
        p.loadURDF({str(tmp_path / "arm.urdf")!r}, useMaximalCoordinates=True)
        for _ in range(5):
            p.stepSimulation()
        """,
        tmp_path / "arm.rrd",
    )
    result = compared(path, path)
    assert (result.first, result.same, result.not_compared) == (None, False, ["0_arm"])


GRAVITY = "p.setGravity(0, 0, -9.81)\n"
LENS = "p.computeProjectionMatrixFOV(60, 1, 0.1, 10))\n"


def test_a_simulation_without_bodies_is_no_difference(recording: Record, golden: Path) -> None:
    more = recording((GRAVITY, f"{GRAVITY}z = p.connect(p.DIRECT)\np.setGravity(1, 1, 1, z)\n"))
    for run, against in ((more, golden), (golden, more)):
        assert compared(run, against).same


def test_connecting_is_not_a_call_but_can_be_the_cause(recording: Record, golden: Path) -> None:
    again = recording((LENS, f"{LENS}p.disconnect()\np.connect(p.DIRECT)\n"))
    for run, against in ((again, golden), (golden, again)):
        result = compared(run, against)
        assert result.first is not None
        assert (result.first.column, result.cause) == (
            "engine.rows",
            "another text of the script, but the same calls, and a simulation that begins or ends "
            "elsewhere: connecting to PyBullet and disconnecting do not count as calls",
        )


def test_the_same_calls_at_other_steps_are_the_cause(recording: Record, golden: Path) -> None:
    later = recording(("for step in range(60)", "p.stepSimulation()\nfor step in range(60)"))
    result = compared(later, golden)
    assert result.other_call is None or result.other_call.moved
    assert result.cause == (
        "another text of the script, but the same calls, at other steps: setJointMotorControl2 at "
        "sim.py:11 after step 1, golden 0"
    )


def test_an_element_not_shown_of_a_long_list_may_be_the_cause(golden: Path) -> None:
    theirs = side(golden)
    first, *others = theirs.seen.calls
    shortened = replace(first, arguments="[0, 1, … 40 values]")
    setting = theirs.seen.settings[0]
    stronger = replace(setting, values={**setting.values, "gravityAccelerationX": 1.0})
    seen = replace(theirs.seen, calls=[shortened, *others])
    settings = [stronger, *theirs.seen.settings[1:]]
    mine = replace(theirs, seen=replace(seen, settings=settings))
    assert compare_scripts(mine, replace(theirs, seen=seen)).cause == (
        "the same calls, as far as recorded: the arguments of "
        f"{first.function} at sim.py:{first.line} are recorded only in part"
    )


def test_another_text_with_the_same_calls_is_the_same_physics(
    recording: Record, golden: Path, drop: Drop
) -> None:
    moved = recording(("import pybullet as p\n", "import pybullet as p\n# a comment\n"))
    done = drop("check", moved, "--against", golden)
    assert done.returncode == 0
    assert "the same from other lines, first 1: setGravity(0, 0, -9.81) at sim.py:5" in (
        " ".join(done.stdout.split())
    )


def test_the_folder_of_a_file_does_not_make_a_call_different(golden: Path) -> None:
    theirs = side(golden)
    calls = [
        replace(call, arguments=call.arguments.replace("'arm.urdf'", "'/home/me/arm.urdf'"))
        for call in theirs.seen.calls
    ]
    assert calls != theirs.seen.calls
    mine = replace(theirs, seen=replace(theirs.seen, calls=calls))
    elsewhere = [replace(call, arguments=call.arguments.replace("/me/", "/ci/")) for call in calls]
    other = replace(theirs, seen=replace(theirs.seen, calls=elsewhere))
    assert compare_scripts(mine, other).other_call is None


def test_two_clients_are_compared_each_by_its_steps(tmp_path: Path) -> None:
    text = scripts.PLAIN["client"].replace("show(pybullet, 0, 1)", "").replace(
        "from show import show", "")  # fmt: skip
    paths = []
    for number, gravity in enumerate(("-9.81 - n", "-9.81 - n", "-9.81 - 2 * n")):
        tmp_path.joinpath("two.py").write_text(textwrap.dedent(text).replace("-9.81 - n", gravity))
        paths.append(tmp_path / f"{number}.rrd")
        record_script(str(tmp_path / "two.py"), out=paths[-1])
    assert compared(paths[1], paths[0]).same
    theirs = side(paths[0])
    second_first = theirs.seen.contacts.sort(
        "step", "body_a", descending=[False, True], maintain_order=True
    )
    assert not second_first.equals(theirs.seen.contacts)
    swapped = replace(theirs, seen=replace(theirs.seen, contacts=second_first))
    assert compare_scripts(swapped, theirs).same
    result = compared(paths[2], paths[0])
    assert result.first == Difference(0, None, None, "engine.gravityAccelerationZ", -11.81, -10.81)
    assert result.looks_like is not None
    assert result.looks_like.startswith("3_cube_small is 0.0174 mm off at step 1, ")


def test_the_numbers_of_clients_do_not_count(tmp_path: Path) -> None:
    """A connection that is not used shifts them, as does one that a notebook left open."""
    text = """
        import sys, pybullet as p
        for _ in range(int(sys.argv[1])):
            p.connect(p.DIRECT)
        c = p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81, physicsClientId=c)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=c)
        for z in (0, 0.19):
            p.createMultiBody(1, ball, basePosition=[0, 0, z], physicsClientId=c)
        for i in range(50):
            p.stepSimulation(physicsClientId=c)
        """
    first, second = (recorded(text, tmp_path / f"{n}.rrd", str(n)) for n in range(2))
    assert len(side(first).seen.contacts)
    for run, against in ((first, second), (second, first), (first, first)):
        for tolerance_m in (0.0, 1e-3):
            result = compared(run, against, tolerance_m=tolerance_m)
            assert (result.same, result.other_call) == (True, None)
    slower = recorded(text.replace("-9.81", "-1.6"), tmp_path / "moon.rrd", "1")
    result = compared(slower, first)
    assert result.first == Difference(0, None, None, "engine.gravityAccelerationZ", -1.6, -9.81)


TURNS = """
    import sys, pybullet as p
    clients = [p.connect(p.DIRECT) for _ in range(3)]
    turns = clients if sys.argv[1] == "forward" else clients[::-1]
    def balls(c):
        p.setGravity(0, 0, -9.81 - c, physicsClientId=c)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=c)
        p.createMultiBody(0, ball, physicsClientId=c)
        p.createMultiBody(1 + c, ball, basePosition=[0, 0, 0.19 + 0.02 * c], physicsClientId=c)
    for c in turns:
        balls(c)
    for i in range(30):
        for c in turns:
            p.stepSimulation(physicsClientId=c)
    """
"""Simulations that take turns, as threads do; which is first depends on the argument."""


def test_which_simulation_is_first_does_not_count(tmp_path: Path) -> None:
    paths = [recorded(TURNS, tmp_path / f"{order}.rrd", order) for order in ("forward", "back")]
    labels = [{body.client: body.label for body in side(path).seen.bodies.values()}
              for path in paths]  # fmt: skip
    assert labels[0] != labels[1]
    for run, golden in (paths, paths[::-1]):
        for tolerance_m in (0.0, 1e-3):
            result = compared(run, golden, tolerance_m=tolerance_m)
            assert (result.same, result.other_call) == (True, None)
            assert result.largest_difference_m == 0.0
    text = TURNS.replace("-9.81 - c", "-9.81 - 2 * c")
    other = recorded(text, tmp_path / "other.rrd", "forward")
    result = compared(other, paths[1])
    assert result.first is not None
    assert result.first.column == "engine.gravityAccelerationZ"
    assert result.other_call is not None
    calls = result.other_call.value, result.other_call.golden
    assert [call and call.arguments for call in calls] == ["0, 0, -13.81", "0, 0, -11.81"]


def test_one_of_several_simulations_may_end_earlier(tmp_path: Path) -> None:
    text = TURNS.replace(
        "        p.stepSimulation(physicsClientId=c)",
        "        if i < 20 or c or sys.argv[1] == 'forward':\n"
        "                p.stepSimulation(physicsClientId=c)",
    )
    whole, short = (recorded(text, tmp_path / f"{order}.rrd", order) for order in ("forward", "b"))
    result = compared(short, whole)
    assert result.cause == (
        "the same calls as far as both go: simulation 0 ended after step 20, golden after step 30"
    )


def test_what_was_read_between_two_calls_does_not_count(tmp_path: Path) -> None:
    """A constraint makes the recorder read a body before the next call changes it."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
        a, b = (p.createMultiBody(1, ball, -1, [place, 0, 0]) for place in (0, 1))
        if sys.argv[1] == "held":
            p.createConstraint(a, -1, b, -1, p.JOINT_FIXED, [0] * 3, [1, 0, 0], [0] * 3)
        p.changeDynamics(b, -1, lateralFriction=0.7)
        for i in range(20):
            p.stepSimulation()
        """
    held, loose = (recorded(text, tmp_path / f"{how}.rrd", how) for how in ("held", "loose"))
    result = compared(held, loose)
    assert {each.column.partition(".")[0] for each in result.differences} == {"constraints"}


def test_twice_the_same_in_whatever_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = TURNS.replace('sys.argv[1] == "forward"', "not Path('ran').exists()")
    text = text.replace("for c in turns:", "Path('ran').touch()\n    for c in turns:", 1)
    script = tmp_path / "turns.py"
    script.write_text(textwrap.dedent("    from pathlib import Path" + text))
    monkeypatch.chdir(tmp_path)
    again = record_script(str(script), out=tmp_path / "twice.rrd", twice=True)
    assert (tmp_path / "ran").exists()
    assert (again.twice, again.first_difference) == (True, None)


def test_states_within_a_tolerance_are_not_called_identical(tmp_path: Path) -> None:
    """Though an input differs: a push of 1 N in one step."""
    paths = []
    for force in (0, 1):
        paths.append(tmp_path / f"{force}.rrd")
        scenes.record(
            "b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))\n"
            f"steps(5)\np.applyExternalForce(b, -1, [{force}, 0, 0], [0, 0, 0], p.LINK_FRAME)\n"
            "steps(5)",
            paths[-1],
        )
    for tolerance_m, words in ((1, "is within the tolerance"), (1e-9, "mm off at step")):
        result = compare_scripts(*map(side, paths), tolerance_m=tolerance_m)
        assert not result.same
        assert words in str(result.looks_like)


def test_a_tolerance_takes_a_quaternion_and_its_negative_for_the_same(tmp_path: Path) -> None:
    """Bullet makes them from matrices: at 120° the sign changes, here at different steps."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .2, .3])
        b = p.createMultiBody(1, box, useMaximalCoordinates=True)
        p.resetBaseVelocity(b, [0, 0, 0], [-float(sys.argv[1]), 0, 0])
        for _ in range(480):
            p.stepSimulation()
        """
    one, two = (recorded(text, tmp_path / f"{speed}.rrd", speed) for speed in ("5", "4.98"))
    states = [side(path).seen.states.filter(pl.col("link") == -1) for path in (one, two)]
    away = (states[0]["qx"] - states[1]["qx"]).abs().max()
    assert isinstance(away, float)
    assert away > 1
    assert compared(one, two, tolerance_m=0.02).same
    assert not compared(one, two, tolerance_m=0.001).same
    assert not compared(one, two).same


def test_a_tolerance_of_an_angle_is_the_way_of_the_surface(tmp_path: Path) -> None:
    """Half the diagonal is 0.374 m, where 0.05 rad are 18.7 mm."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .2, .3])
        b = p.createMultiBody(1, box, baseOrientation=p.getQuaternionFromEuler(
            [0, 0, float(sys.argv[1])]))
        p.stepSimulation()
        """
    one, two = (recorded(text, tmp_path / f"{angle}.rrd", angle) for angle in ("0", "0.05"))
    of = paired(side(one).seen, side(two).seen)
    for tolerance_m, differs in ((0.0188, False), (0.0186, True)):
        allowance = allowed(of, side(two).seen, tolerance_m)
        assert (first_state(of, allowance) is not None) == differs


def test_a_step_more_differs_though_nothing_moves_any_more(tmp_path: Path) -> None:
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
        b = p.createMultiBody(1, ball)
        p.stepSimulation()
        p.removeBody(b)
        for _ in range(int(sys.argv[1])):
            p.stepSimulation()
        """
    one, two = (recorded(text, tmp_path / f"{n}.rrd", str(n)) for n in (1, 2))
    assert compared(one, one).same
    for run, golden, there in ((one, two, (0.0, 1.0)), (two, one, (1.0, 0.0))):
        result = compared(run, golden)
        assert result.first == Difference(3, None, None, "there", *there)


def test_contact_of_a_link_that_is_not_shown_is_compared(tmp_path: Path) -> None:
    """PyBullet calls the body of such a link -1."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -float(sys.argv[1]))
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1] * 3)
        p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
        p.createMultiBody(
            1, box, -1, [0, 0, 1], p.getQuaternionFromEuler([0, .9, 0]), linkMasses=[1],
            linkCollisionShapeIndices=[box], linkVisualShapeIndices=[-1],
            linkPositions=[[.3, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0, 0]],
            linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
            linkJointTypes=[p.JOINT_FIXED], linkJointAxis=[[0, 0, 1]],
            useMaximalCoordinates=True)
        for i in range(120):
            p.stepSimulation()
        """
    one, two = (recorded(text, tmp_path / f"{n}.rrd", str(n)) for n in (10, 11))
    seen = side(one).seen
    assert -1 in seen.contacts["body_a"].to_list() + seen.contacts["body_b"].to_list()
    differences = first_contact(seen, side(two).seen)
    assert differences is not None
    assert differences[1].body in {body.label for body in seen.bodies.values()}
    assert not compared(one, two).same


def test_the_same_call_in_another_client_is_another(golden: Path) -> None:
    theirs = side(golden)
    first, second, *others = theirs.seen.calls
    seen = replace(theirs.seen, calls=[replace(first, client=1), second, *others])
    result = compare_scripts(replace(theirs, seen=seen), theirs)
    assert result.same
    assert result.other_call is not None
    assert (result.other_call.value, result.other_call.golden) == (second, first)


def test_an_altered_recording_is_refused_by_its_checksum(golden: Path, tmp_path: Path) -> None:
    altered = rewritten(golden, tmp_path / "altered.rrd", schema.STATES.entity, _altered)
    with pytest.raises(
        RecordingError, match="state fails its checksum; record it again with: drop record"
    ):
        check_script(altered, golden)
    with pytest.raises(
        RecordingError, match="state fails its checksum; record it again with: drop record"
    ):
        check_script(golden, altered)


def _altered(chunk: Chunk) -> list[Chunk]:
    """Return a chunk of states with its last position moved by a nanometre."""
    batch = chunk.to_record_batch()
    index = batch.schema.get_field_index("position_m")
    values = batch.column(index).to_pylist()
    values[-1][-1] += 1e-9
    column = pa.array(values, type=batch.schema.field(index).type)
    return Chunk.from_record_batch(batch.set_column(index, batch.schema.field(index), column))


def rewritten(
    source: Path, path: Path, entity: str, change: Callable[[Chunk], list[Chunk]]
) -> Path:
    """Write a recording again, with other chunks of one entity."""
    chunks: list[Chunk] = []
    for chunk in RrdReader(source).stream():
        chunks += change(chunk) if chunk.entity_path == f"/{entity}" else [chunk]
    LazyChunkStream.from_iter(chunks).write_rrd(
        path,
        application_id=schema.APPLICATION_ID,
        recording_id=read_script(source).recording_id,
    )
    return path


# -- both in the viewer ---------------------------------------------------------------------------


def test_bodies_and_heights_of_the_golden_one_are_added_in_grey(
    recording: Record, golden: Path
) -> None:
    changed = recording(("[0, 0, 0.2]", "[0, 0, 0.25]"))
    with with_golden(changed, golden, web=True) as shown:
        (layer,) = [
            Path(argument) for argument in shown.viewer.command if argument.endswith("golden.rrd")
        ]
        assert (shown.same, shown.first_difference) == (False, 0)
        added = {chunk.entity_path: chunk.to_record_batch() for chunk in RrdReader(layer).stream()
                 if "Transform3D:scale" not in chunk.to_record_batch().schema.names}  # fmt: skip
        drawn = {chunk.entity_path: chunk.to_record_batch() for chunk in RrdReader(layer).stream()
                 if "Transform3D:scale" in chunk.to_record_batch().schema.names}  # fmt: skip
        assert read_id(layer) == read_id(changed)
    assert not layer.exists()
    tops = {"/".join(entity.split("/")[:4]) for entity in {**added, **drawn}}
    assert tops == {"/world/golden/1_sphere", "/world/golden/2_arm", "/height/golden/1_sphere"}
    colours_seen = drawn["/world/golden/1_sphere/base/0"].column("Ellipsoids3D:colors").to_pylist()
    assert colours_seen == [[0xC3C8CF60]]
    positions = added["/world/golden/1_sphere/base"].column("Transform3D:translation")
    of_golden = [
        chunk.to_record_batch().column("Transform3D:translation")
        for chunk in RrdReader(golden).stream()
        if chunk.entity_path == "/world/1_sphere/base"
    ]
    assert [positions] == of_golden


def test_a_drop_and_its_golden_one_are_seen_together(tmp_path: Path) -> None:
    simulate(Scenario(duration_s=0.1), tmp_path / "run.rrd", camera=None)
    undamped = tmp_path / "undamped.rrd"
    simulate(Scenario(duration_s=0.1, linear_damping=0.0), undamped, camera=None)
    with with_golden(undamped, tmp_path / "run.rrd", web=True) as shown:
        added = {chunk.entity_path for chunk in RrdReader(Path(shown.viewer.command[2])).stream()}
        assert (shown.same, shown.first_difference) == (False, 2)
    assert added == {"/world/golden", "/height/golden"}


@pytest.mark.skipif(vulkan_driver() is None, reason="no software Vulkan")
def test_both_open_as_one_recording_at_the_first_difference(
    recording: Record, golden: Path
) -> None:
    changed = recording(("[0.5, 0, 0]", "[0.7, 0, 0]"))
    with with_golden(changed, golden, web=True) as shown:
        layer = next(
            Path(argument) for argument in shown.viewer.command if argument.endswith("golden.rrd")
        )
        with Viewer(changed, layer) as viewer:
            port = int(viewer.url.split(":")[2].split("/")[0])
            assert shown.first_difference == 21
            program.put_cursor(program.Viewer([], port, None), 0.3, viewer.process, step=21)
            state = viewer.client.get_state()
            (opened,) = state.recordings
            assert (opened.current_timeline, opened.current_time) == ("sim_step", 21)
            assert "Heights of free bodies [m]" in [view.name for view in state.views]
            assert viewer.warnings() == []
            heights = next(v for v in state.views if v.name == "Heights of free bodies [m]")
            viewer.settled()
            assert has_colour(viewer.picture(heights.view_id), colours.GOLDEN)


def test_several_recordings_have_no_golden_one(golden: Path, drop: Drop) -> None:
    done = drop("view", golden, golden, "--against", golden)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


def test_an_image_that_was_altered_is_damage(golden: Path, tmp_path: Path) -> None:
    """Its digest is checked, even if both recordings claim the same one."""

    def change(chunk: Chunk) -> list[Chunk]:
        batch = chunk.to_record_batch()
        index = batch.schema.get_field_index("EncodedImage:blob")
        if index < 0:
            return [chunk]
        pngs = [[bytes(png) for png in row] for row in batch.column(index).to_pylist()]
        pngs[0][0] = pngs[0][0][:-20] + bytes([pngs[0][0][-20] ^ 1]) + pngs[0][0][-19:]
        values = [[list(png) for png in row] for row in pngs]
        field = batch.schema.field(index)
        column = pa.array(values, type=field.type)
        return Chunk.from_record_batch(batch.set_column(index, field, column))

    altered = rewritten(golden, tmp_path / "altered.rrd", "camera/0/image", change)
    with pytest.raises(RecordingError, match="its frames fail their checksum"):
        check_script(altered, golden)


@pytest.mark.parametrize(
    ("entity", "name", "value"),
    [
        ("__properties/recording", "ended", ["finishee"]),
        ("__properties/recording", "made_with_real_time", [True]),
        ("engine", "time_s", [0.5]),
    ],
)
def test_a_recordings_properties_have_a_checksum(
    golden: Path, tmp_path: Path, entity: str, name: str, value: list[Any]
) -> None:
    def change(chunk: Chunk) -> list[Chunk]:
        batch = chunk.to_record_batch()
        index = batch.schema.get_field_index(name)
        rows = batch.column(index).to_pylist()
        column = pa.array([value, *rows[1:]], type=batch.schema.field(index).type)
        return Chunk.from_record_batch(batch.set_column(index, batch.schema.field(index), column))

    altered = rewritten(golden, tmp_path / "altered.rrd", entity, change)
    with pytest.raises(RecordingError, match=r"fails its checksum; .*: drop record"):
        read_script(altered)

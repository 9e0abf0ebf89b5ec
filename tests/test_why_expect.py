"""`drop why --expect`: the single change to a script that makes its expectation true."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from command import drop_here
from conftest import some
from drop_physics.account.rows import AccountRow, RowTerm
from drop_physics.engines.watching.single_changes import Change
from drop_physics.experiments.search import ChangeOutcome
from drop_physics.report.expected import sections_of
from drop_physics.stages.why.expect import Expected, likely
from drop_physics.stages.why.row import row_expectation

SCHEMA = json.loads((Path(__file__).parents[1] / "docs/schemas/why.json").read_text("utf-8"))
SLIDES = """
import mujoco
XML = '''<mujoco><worldbody><geom name="floor" type="plane" size="5 5 1" friction="0.1"/>
<body name="box" pos="0 0 .1"><freejoint/>
<geom name="box" type="box" size=".1 .1 .1" friction="0.1"/></body></worldbody></mujoco>'''
SPEED = 1
def main():
    m = mujoco.MjModel.from_xml_string(XML)
    d = mujoco.MjData(m)
    d.qvel[0] = SPEED
    for step in range(60):
        mujoco.mj_step(m, d)
    slid = d.qpos[0]
    print("slid", slid)
main()
"""
SAGS = """
import pybullet as p
def main():
    p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
    body = p.createMultiBody(1, box, basePosition=[0, 0, 1])
    hook = p.createConstraint(body, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 1])
    p.changeConstraint(hook, maxForce=5)
    for step in range(120):
        p.stepSimulation()
    height = p.getBasePositionAndOrientation(body)[0][2]
    p.disconnect()
main()
"""


DIE = """
import mujoco
XML = '''<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="3 3 .1"/>
<body name="die" pos="0 0 1.2" euler="33 21 57"><freejoint/><geom type="box" size=".05 .05 .05"
 mass=".2" friction=".5 .005 .0001" solref="-20000 -25"/></body></worldbody></mujoco>'''
m = mujoco.MjModel.from_xml_string(XML)
d = mujoco.MjData(m)
d.qvel[:] = [0.7, 0.3, 0, 13, 9, 17]
for _ in range(1400):
    mujoco.mj_step(m, d)
R = d.body("die").xmat.reshape(3, 3)
face = int(abs(R[2]).argmax()) * 2 + int(R[2][abs(R[2]).argmax()] < 0)
"""


def why(folder: Path, script: str, *options: str) -> tuple[int, dict[str, Any], str]:
    """Return exit code, JSON and messages of a search on a script."""
    folder.joinpath("script.py").write_text(script)
    script_of = [] if "-m" in options else ["script.py"]
    done = drop_here("why", "--json", "--budget", "600", *options, *script_of, folder=folder)
    found = json.loads(done.stdout)
    if "error" not in found:
        jsonschema.validate(found, SCHEMA)
    return done.returncode, found, done.stderr


def test_the_friction_of_a_box_that_slides_is_found(tmp_path: Path) -> None:
    code, found, _ = why(tmp_path, SLIDES, "--expect", "x('box') < 0.08")
    assert code == 3
    assert not found["expectation"]["holds"]
    assert found["expectation"]["value"] > 0.1
    assert found["complete"]
    assert not found["chaotic"]
    first = next(each for each in found["makes_true"] if each["change"] == "geom_friction")
    assert first["target"] in (["box"], ["floor"]), "MuJoCo takes the larger of two"
    assert first["result"] < 0.08
    assert not first["breaks"]
    assert first in found["makes_true"][:3]
    assert first["site"] == "script.py:3"
    assert "slid" in first["row"], "the account names it, too"
    assert first["from_step"] == 15, "it takes 5 cm: after 6 cm it is too late"
    breaking = [each["breaks"] for each in found["makes_true"]]
    assert breaking == sorted(breaking)
    slower = next(each for each in found["makes_true"] if each["change"] == "SPEED")
    assert (slower["site"], slower["op"], slower["row"]) == ("script.py:6", "*0.1", None)
    assert slower["call"] == "SPEED 0.1 in place of 1 (script.py:6)"
    assert slower["result"] < 0.02, "a tenth of the speed slides a hundredth of the way"
    # What is printed, `--try` takes without an expectation, too.
    code, tried, _ = why(tmp_path, SLIDES, "--try", slower["try"], "--try", first["try"])
    assert code == 0
    assert {each["name"] for each in tried["hangs_on"]} == {slower["try"], first["try"]}
    assert all(each["moved"]["body"] == "1_box" for each in tried["hangs_on"])


def test_what_holds_is_said_after_one_run_and_a_local_name_is_known(tmp_path: Path) -> None:
    code, found, _ = why(tmp_path, SLIDES, "--expect", "slid > 0.1 and printed[-1] == slid")
    assert (code, found["runs"], found["makes_true"]) == (0, 0, [])
    assert found["expectation"]["holds"]


def test_what_is_often_to_blame_is_tried_first_and_inner_workings_of_the_engine_late() -> None:
    """Calls that are left out; flags of a call; factors; the engine's own flags."""
    added = Change("setGravity.gravZ", "=-9.81", ("=-9.81", {"call": "setGravity"}))
    order = [
        added,
        *(
            Change(*each, ("", None))
            for each in (("loadURDF.flags", "^8"), ("geom_friction", "*10"))
        ),
        Change("flag.WARMSTART", "^", ("^", None)),
        Change("dof_damping", "*-1", ("*", -1)),
    ]
    backwards = order[::-1]
    assert sorted(backwards, key=likely) == order


@pytest.mark.long
def test_what_nothing_makes_true_is_said_with_what_comes_nearest(tmp_path: Path) -> None:
    far = '<body name="far" pos="0 3 .1"><freejoint/><geom size=".1"/></body></worldbody>'
    script = SLIDES.replace("</worldbody>", far)
    code, found, _ = why(tmp_path, script, "--expect", "z('far') > 1000")
    assert (code, found["makes_true"], found["complete"]) == (3, [], True)
    assert all(each["result"] > found["expectation"]["value"] for each in found["moves"])


@pytest.mark.long
def test_chance_decides_where_nudges_move_the_number_as_far_as_what_is_missing(
    tmp_path: Path,
) -> None:
    """A die falls on another face if it is moved by 1e-9, though on none that is expected."""
    code, found, _ = why(tmp_path, DIE, "--expect", "face == 3")
    assert (code, found["chaotic"], found["makes_true"]) == (3, True, [])
    assert found["noise"]["value"] >= abs(found["expectation"]["margin"]) == 2


def test_a_number_has_the_digits_that_tell_it_from_what_was_expected() -> None:
    (said, *_) = sections_of(
        Expected("reached > 0.9", "option", ChangeOutcome(False, -0.0003149, 0.8996851)),
        every=False,
    )
    assert "no, 0.89969" in said.blocks[0].text
    for value, margin, digits in ((0.341, 0.041, "0.341"), (20_688.0, -0.04, "20,688.00")):
        outcome = ChangeOutcome(True, margin, value)
        (said, *_) = sections_of(Expected("a > b", "option", outcome), every=False)
        assert said.blocks[0].text.endswith(digits)


@pytest.mark.long
@pytest.mark.pybullet
def test_a_constraint_that_is_too_weak_is_found_though_the_script_disconnects(
    tmp_path: Path,
) -> None:
    expected = "p.getBasePositionAndOrientation(body)[0][2] > 0.99"
    code, found, _ = why(tmp_path, SAGS, "--expect", expected)
    assert code == 3
    assert any("maxForce" in each["change"] for each in found["makes_true"][:3])


ASSERTS = SLIDES.replace('print("slid", slid)', 'assert slid < 0.08, "too far"')


@pytest.mark.pybullet
def test_bodies_have_the_names_that_reports_show(tmp_path: Path) -> None:
    """Two spheres share a name, so that only their labels tell them apart."""
    script = """
import pybullet as p
import pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.loadURDF("plane.urdf")
p.loadURDF("r2d2.urdf", [0, 0, 4])
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
for height in (2, 3):
    p.createMultiBody(1, ball, -1, [5, 0, height])
other = p.connect(p.DIRECT)
p.loadURDF("plane.urdf", [0, 0, -7], physicsClientId=other)
p.loadURDF("cube.urdf", [0, 0, 9], physicsClientId=other)
for client in (0, other):
    p.stepSimulation(client)
"""
    told = " and ".join(
        (
            "1 < z('2_sphere') < 2.5 < z('3_sphere') < 3.5 < z('1_r2d2') < 4.5",
            "z('r2d2') == z('1_r2d2') and abs(joint('1_r2d2.head_swivel')) < 1e-3",
            "force('2_sphere', '3_sphere') == 0 and 8.5 < z('5_cube') == z('cube')",
        )
    )
    _, found, _ = why(tmp_path, script, "--expect", told)
    assert found["expectation"]["holds"]
    # Either simulation has a plane, and the engine gives both the same id.
    code, found, _ = why(tmp_path, script, "--expect", "z('0_plane') < 1")
    assert (code, "names 0_plane" in found["error"]) == (2, True)


@pytest.mark.long
def test_an_assert_that_fails_says_what_is_expected(tmp_path: Path) -> None:
    code, found, _ = why(tmp_path, ASSERTS, "--try", "geom_friction *10", "--try", "friction=8")
    assert code == 0, "as without --expect"
    expected = found["expectation"]
    assert (expected["text"], expected["source"]) == ("slid < 0.08", "assert")
    assert expected["site"] == "script.py:14"
    assert expected["margin"] == pytest.approx(0.08 - expected["value"])
    tried = {each["change"] for each in found["makes_true"]}
    assert tried == {"geom_friction", "friction=8"}, "what is asked for, and nothing else"
    assert all(each["result"] < 0.08 for each in found["makes_true"])


@pytest.mark.long
def test_an_assert_of_a_test_counts_too(tmp_path: Path) -> None:
    test = ASSERTS.replace("def main():", "def test_it():").replace("\nmain()", "")
    tmp_path.joinpath("test_slides.py").write_text(test)
    one = ("--try", "geom_friction *10")  # each run of pytest takes a second
    code, found, _ = why(tmp_path, "", *one, "-m", "pytest", "-q", "test_slides.py::test_it")
    assert code == 0
    assert found["expectation"]["site"] == "test_slides.py:14"
    assert [each["change"] for each in found["makes_true"]] == ["geom_friction"]


BLOCKED = """
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
<body name="thigh" pos="0 0 1"><geom name="bone" type="capsule" fromto="0 0 0 0 0 -.3" size=".04"/>
<body name="shin" pos="0 0 -.3"><joint name="knee" axis="0 1 0" damping="1"/>
<geom name="calf" type="capsule" fromto="0 0 -.1 0 0 -.3" size=".03" mass=".5"/>
<geom name="guard" type="box" size=".03 .03 .05" pos=".1 0 .1" mass=".1"/></body></body>
</worldbody><actuator><position joint="knee" kp="30" kv="1"/></actuator></mujoco>''')
d = mujoco.MjData(m)
for step in range(150):
    d.ctrl[0] = -1.2
    mujoco.mj_step(m, d)
"""


@pytest.mark.long
def test_what_was_asked_of_a_joint_is_expected_where_no_finding_has_a_trial(tmp_path: Path) -> None:
    code, found, _ = why(tmp_path, BLOCKED)
    assert code == 0
    (finding,) = found["findings"]
    assert (finding["code"], finding["verdict"]) == ("off-target", "untried")
    expected = found["expectation"]
    assert expected["source"] == "row"
    assert "joint('knee')" in expected["text"]
    assert expected["value"] > 0.9
    cause = next(each for each in found["makes_true"] if each["change"] == "pair")
    assert sorted(cause["target"][0].split(" x ")) == ["bone", "guard"]
    assert "knee" in cause["row"], "a term of it is the contact"
    assert all(each["result"] < 0.2 * expected["value"] for each in found["makes_true"])


def row(kind: Any = "asked", **given: Any) -> AccountRow:
    """Return an account row of a joint that is 0.2 rad short of 0.5 rad at 2 s."""
    number = {"asked": 0.5, "got": 0.3, "gap": -0.2, "unit": "rad", "time_s": 2.0, "salience": 0.4}
    term = RowTerm(cause="joint damping", words="damping", value=-1.0, unit="N m", towards=False)
    named: Any = {"body": "0_arm", "joint": "elbow", "told": "0.5 rad", "terms": (term,)}
    return AccountRow(kind=kind, **{**named, **number, **given})


def test_the_first_row_of_a_joint_that_is_far_off_is_an_expectation() -> None:
    rows = [row("press", joint=None), row(salience=0.1), row(time_s=None), row(), row(joint="hand")]
    found = row_expectation(rows, [])
    assert found is not None
    assert found.text == "abs(at(joint('elbow'), 2) - 0.5) < 0.04"
    assert found.names(Change("dof_damping", "=0", ("=", 0.0)))
    assert not found.names(Change("geom_friction", "*10", ("*", 10.0)))
    assert row_expectation(rows[:3], []) is None
    fast = row_expectation([row(unit="m/s")], [])
    assert fast is not None
    assert "rate('elbow')" in fast.text


@pytest.mark.parametrize(
    ("text", "said"),
    some(
        [
            ("z('boks') > 1", "the nearest names: box"),
            ("slit > 1", "the nearest names: slid"),
            ("z('box' > 1", "takes a Python expression"),
            ("1 / 0 > 1", "ZeroDivisionError"),
        ],
        1,
    ),
)
def test_what_cannot_be_evaluated_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    code, found, errors = why(tmp_path, SLIDES, "--expect", text)
    assert code == 2
    assert said in found["error"]
    assert len([line for line in errors.splitlines() if line.startswith("drop: ")]) == 1

"""Findings of `drop analyze` about a recorded MuJoCo script.

Verification: every step is a sum with the mass matrix of our own kinematics, of a machine that has
something of every kind; energy and momentum by cause add up to the change; what was not replayed is
never explained, and says why.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import some
from drop_physics.analysis.results import Analysis, BodyAnalysis
from drop_physics.explain.replayed import Replayed
from drop_physics.recording.reader import read
from drop_physics.stages.analyze import analyze, explaining
from drop_physics.stages.record import Recorded, record_script
from drop_physics.trace.history import Piece, Sampled
from mujoco_scripts import MACHINE
from test_mujoco_explain import DRIVEN, INTEGRATORS, STEPS

CLOSES = 1e-11
"""Tolerance for rounding in a body's sum, relative to its largest term."""


@dataclass(frozen=True)
class Told:
    """A recording and its analysis."""

    recorded: Recorded
    analysis: Analysis

    def body(self, name: str) -> BodyAnalysis:
        """Return a body by its name."""
        (found,) = (body for body in self.analysis.bodies if body.name == name)
        return found


def told(folder: Path, text: str, *, explain: bool = True, at_s: tuple[float, ...] = ()) -> Told:
    """Record a script, and analyze the recording."""
    script = folder / "script.py"
    script.write_text(text)
    with (folder / "printed.txt").open("wb") as printed:
        recorded = record_script(
            str(script), out=folder / "run.rrd", stdout=printed.fileno(), explain=explain
        )
    return Told(recorded, analyze(recorded.recording, at_s=at_s))


@pytest.fixture(scope="module", params=some(INTEGRATORS, 1))
def machine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Told:
    integrator = f"m.opt.integrator = mujoco.mjtIntegrator.mjINT_{request.param}"
    text = f"{DRIVEN}m = mujoco.MjModel.from_xml_string('''{MACHINE}''')\n{integrator}\n"
    return told(tmp_path_factory.mktemp("machine"), f"{text}driven(m, {STEPS})\n", at_s=(0.09,))


def test_every_step_is_a_sum_by_our_own_kinematics(machine: Told) -> None:
    replay = machine.recorded.replay
    assert replay is not None
    assert (replay.steps, replay.replayed, replay.explained) == (STEPS, STEPS, STEPS)
    assert replay.remainder < 1e-12
    for body in machine.analysis.bodies:
        assert body.unexplained == [], body.name
    assert machine.analysis.explained.remainder < CLOSES


class _Shifted(NamedTuple):
    """A recording whose cart is shifted from a step on."""

    sampled: Sampled
    cart: int
    from_step: int
    by_m: float

    @property
    def first(self) -> int:
        return self.sampled.first

    @property
    def last(self) -> int:
        return self.sampled.last

    def piece(self, first: int, end: int) -> Piece:
        piece = self.sampled.piece(first, end)
        joints = piece.joints[self.cart]
        position = joints.position.copy()
        position[joints.steps >= self.from_step, 0] += self.by_m
        moved = replace(joints, position=position)
        return replace(piece, joints={**piece.joints, self.cart: moved})


@pytest.mark.parametrize(("by_m", "unexplained"), [(1e-13, 0), (1e-11, 1)])
def test_a_pose_that_velocities_do_not_lead_to_is_not_explained(
    machine: Told, by_m: float, unexplained: int
) -> None:
    """The sum of impulses still closes: shifting the whole cart does not change the mass matrix."""
    seen = read(machine.recorded.recording).seen
    if (
        seen.settings[0].values["integrator"] == 1.0
    ):  # its poses are judged where its stages are known
        unexplained = 0
    (cart,) = (number for number, body in seen.bodies.items() if body.name == "cart")
    shifted = replace(seen, sampled=_Shifted(seen.sampled, cart, 50, by_m))
    found = [
        step
        for piece in Replayed(shifted).pieces()
        for step, why in zip(piece.bodies[cart].steps, piece.bodies[cart].why, strict=True)
        if why >= 0
    ]
    assert found == [50] * unexplained


def test_energy_and_momentum_by_cause_add_up(machine: Told) -> None:
    seen = 0
    for body in machine.analysis.bodies:
        if body.energy is not None:
            changed = body.energy.end_j - body.energy.start_j
            causes = [*body.energy.by_cause_j.values()]
            scale = max(map(abs, causes))
            np.testing.assert_allclose(sum(causes), changed, atol=1e-11 * scale)
            assert abs(body.energy.by_cause_j["remainder"]) < CLOSES * scale
            seen += 1
        if body.momentum is not None:
            moved = np.subtract(body.momentum.end_kg_m_s, body.momentum.start_kg_m_s)
            parts = np.sum([*body.momentum.by_cause_kg_m_s.values()], axis=0)
            np.testing.assert_allclose(parts, moved, atol=1e-10)
    assert seen == 6


def test_causes_have_their_names(machine: Told) -> None:
    cart, lifted = machine.body("cart").energy, machine.body("lifted").energy
    assert cart is not None
    assert lifted is not None
    assert {"actuator push", "actuator bend", "spring", "friction loss"} <= {*cart.by_cause_j}
    assert {"gravity compensation", "tendon sum", "tendon rope"} <= {*lifted.by_cause_j}
    (each,) = machine.body("cart").at
    assert each.terms is not None
    assert each.remainder is not None
    total = np.sum([*each.terms.values(), each.remainder], axis=0)
    assert np.isfinite(total).all()
    joints = {row.name: row for row in machine.body("cart").joints}
    assert joints["elbow"].control == "position"
    assert joints["tilt"].control == "velocity"
    assert joints["x"].control == "torque"


def test_actuators_say_what_they_were_given(machine: Told) -> None:
    rows = {row.name: row for row in machine.body("cart").actuators}
    assert rows["bend"].kind == "position"
    assert rows["bend"].force_range == (-4.0, 4.0)
    assert rows["bend"].at_force_limit_steps > 0
    assert rows["bend"].force is not None
    assert abs(rows["bend"].force) <= 4.0 * (1 + 1e-9)
    assert rows["push"].beyond_range_steps == 0, "2 is within -5 to 5"
    assert rows["push"].given is not None
    assert rows["roll"].force == rows["roll"].given, "a motor on a ball joint, of gain 1"


WAITS = """
import mujoco, numpy as np
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><geom type="plane" size="5 5 1"/>
<body pos="0 0 1"><joint name="j" axis="0 1 0"/><geom type="capsule" size="0.05"
fromto="0 0 0 0.3 0 0"/></body></worldbody></mujoco>''')
d = mujoco.MjData(m)
"""
OTHERS = {
    "stale": (WAITS + "mujoco.mj_step(m, d, 20)\nd.qpos[0] = 1\nmujoco.mj_step2(m, d)\n", 1),
    "auto-reset": (
        WAITS + "mujoco.mj_step(m, d, 20)\nd.qvel[0] = float('nan')\nmujoco.mj_step(m, d)\n",
        1,
    ),
}


@pytest.mark.parametrize("reason", OTHERS)
def test_what_has_no_sum_says_why(tmp_path: Path, reason: str) -> None:
    text, count = OTHERS[reason]
    found = told(tmp_path, text)
    (moving,) = (body for body in found.analysis.bodies if body.joints)
    assert [(each.reason, each.samples) for each in moving.unexplained] == [(reason, count)]
    assert moving.unexplained[0].first_step == 21


def test_without_a_replay_nothing_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explaining.metadata, "version", lambda _: "3.3.0")
    found = told(tmp_path, WAITS + "mujoco.mj_step(m, d, 20)\n", explain=False)
    (moving,) = (body for body in found.analysis.bodies if body.joints)
    assert [(each.reason, each.samples) for each in moving.unexplained] == [("not asked", 20)]
    assert moving.energy is None
    assert found.analysis.findings == []


PUSHES = """
import mujoco, numpy as np
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
<geom name="floor" type="plane" size="5 5 1" friction="0.5"/>
<body name="box" pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="2"
friction="0.4"/></body></worldbody></mujoco>''')
d = mujoco.MjData(m)
mujoco.mj_step(m, d, 100)
d.xfrc_applied[1, 0] = 20
mujoco.mj_step(m, d, 100)
"""


BROKEN = (
    WAITS.replace('<joint name="j" axis="0 1 0"/>', "<freejoint/>")
    + """
mujoco.mj_step(m, d, 20)
d.xfrc_applied[1, 2] = 1e308
mujoco.mj_step(m, d)
mujoco.mj_step(m, d, 79)
"""
)


def test_a_force_that_breaks_a_state_is_told_with_its_number_and_lasts_until_the_reset(
    tmp_path: Path,
) -> None:
    """MuJoCo resets itself, which clears forces: the push acted in one step of eighty."""
    (found,) = told(tmp_path, BROKEN).analysis.findings
    assert found.code == "auto-reset"
    assert "huge or no number after xfrc_applied was given 1e+308" in found.message
    assert found.site is not None


EDITED = """
import mujoco
m = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom type="plane" size="5 5 1"/>'
    '<body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    '<body name="cart" pos="0 3 1"><joint type="slide" axis="1 0 0" springref="1" stiffness="9" '
    'armature=".3"/><geom size=".1"/></body></worldbody></mujoco>')
d = mujoco.MjData(m)
mujoco.mj_step(m, d, 20)
m.body_mass[1:] *= 3
mujoco.mj_step(m, d, 20)
m.body_inertia[1] *= 2
d.qvel[3:6] = 3, 2, 1
mujoco.mj_step(m, d, 20)
mujoco.mj_setConst(m, mujoco.MjData(m))
mujoco.mj_step(m, d, 20)
"""


def test_bodies_whose_mass_is_edited_in_place_are_explained(tmp_path: Path) -> None:
    """Until `mj_setConst`, MuJoCo's gravity uses the new mass, inertia the old one (`dof_M0`)."""
    analysis = told(tmp_path, EDITED).analysis
    box, cart = (body for body in analysis.bodies if body.name != "world")
    for body in (box, cart):
        assert body.unexplained == [], body.name
        assert body.energy is not None
        assert abs(body.energy.by_cause_j["remainder"]) < 1e-11
    assert analysis.explained.remainder < CLOSES


def test_a_push_and_friction_are_seen(tmp_path: Path) -> None:
    """Friction takes half of 19.6 N from the push of 20 N, and the sliding body gets the rest."""
    found = told(tmp_path, PUSHES)
    box = found.body("box")
    assert box.momentum is not None
    np.testing.assert_allclose(box.momentum.by_cause_kg_m_s["applied"][0], 20 * 0.2, rtol=1e-9)
    (touch,) = box.touches
    assert touch.other == "0_world"
    assert touch.friction == 0.5, "MuJoCo takes the larger of both"
    assert touch.used is not None
    np.testing.assert_allclose(touch.used, 1.0, atol=0.02)
    assert [each.code for each in found.analysis.findings] == ["push-stays"]
    held = read(found.recorded.recording)
    assert held.seen.frictions == {(1, -1, 0, -1): 0.5}


def test_what_the_end_of_a_tendon_takes_no_pose_needs(tmp_path: Path) -> None:
    """The elbow turns about a vertical axis: the tendon balances the servo's torque."""
    model = """<mujoco><worldbody><body name="arm"><joint name="elbow" axis="0 0 1" damping="2"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/></body></worldbody>
    <tendon><fixed name="cable" range="0 0.36" limited="true"><joint joint="elbow" coef="1"/>
    </fixed></tendon><actuator><position joint="elbow" kp="40" kv="2"/></actuator></mujoco>"""
    found = told(
        tmp_path,
        f"import mujoco\nm = mujoco.MjModel.from_xml_string('''{model}''')\n"
        "d = mujoco.MjData(m)\nd.ctrl[0] = 1\nmujoco.mj_step(m, d, 1500)\n",
    )
    arm = found.body("arm")
    assert arm.energy is not None
    assert "tendon limit cable" in arm.energy.by_cause_j
    (elbow,) = arm.joints
    assert elbow.off is not None
    assert elbow.off < -0.5
    assert elbow.needs is None
    (finding,) = found.analysis.findings
    assert (finding.code, finding.advice) == ("off-target", None)
    assert "the limit of the tendon cable holds 25 N m of the 25 N m" in finding.message


ARM = """
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><option integrator="implicitfast"/><worldbody>
<geom type="plane" size="5 5 1"/>
<body name="base" pos="0 0 1"><geom type="box" size="0.05 0.05 0.05"/>
<body name="{child}" pos="{at} 0 0"><joint name="soft" axis="0 1 0" damping="5"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/></body></body>
<body name="box" pos="2 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body></worldbody>
<actuator><position name="servo" joint="soft" kp="{kp}" {more}/></actuator></mujoco>''')
d = mujoco.MjData(m)
d.ctrl[0] = 0.3
"""
ANSWERED = {
    "spring": (
        {"kp": 60, "more": 'kv="2"'},
        "mujoco.mj_step(m, d, 3000)\n",
        "off-target",
        "spring",
    ),
    "blocked": (
        {"kp": 60, "more": 'kv="2"', "at": 0.2},
        "m.body_pos[1, 2] = 0.1\nmujoco.mj_setConst(m, d)\nd.ctrl[0] = 1\n"
        "mujoco.mj_step(m, d, 3000)\n",
        "off-target",
        None,
    ),
    "forcerange": (
        {"kp": 500, "more": 'kv="5" forcerange="-1 1"'},
        "mujoco.mj_step(m, d, 3000)\n",
        "off-target",
        "forcerange",
    ),
    "ctrlrange": (
        {"kp": 5000, "more": 'kv="50" ctrlrange="-0.1 0.1"'},
        "mujoco.mj_step(m, d, 3000)\n",
        "target-clamped",
        None,
    ),
    "stiff": (
        {"kp": 1e7, "more": ""},
        "mujoco.mj_step(m, d, 20)\n",
        "unstable",
        None,
    ),
    "inside": (
        {"kp": 5000, "more": 'kv="50"', "at": 0.02},
        "mujoco.mj_step(m, d)\n",
        "static-parent",
        None,
    ),
    "edited": (
        {"kp": 5000, "more": 'kv="50"'},
        "mujoco.mj_step(m, d)\nm.body_mass[3] *= 20\nmujoco.mj_step(m, d)\n",
        "model-edited",
        None,
    ),
    "pushed": (
        {"kp": 5000, "more": 'kv="50"'},
        "mujoco.mj_step(m, d)\nd.xfrc_applied[3, 0] = 1\nmujoco.mj_step(m, d, 100)\n",
        "push-stays",
        None,
    ),
    "written late": (
        {"kp": 5000, "more": 'kv="50"'},
        "mujoco.mj_step(m, d)\nd.qpos[0] = 0.1\nmujoco.mj_step2(m, d)\n",
        "not-replayed",
        "stale",
    ),
    "nothing": (
        {"kp": 5000, "more": 'kv="50"'},
        "d.ctrl[0] = 0\nfor k in range(1000):\n    d.xfrc_applied[3, 0] = 0.1 * (k % 2)\n"
        "    mujoco.mj_step(m, d)\n",
        None,
        None,
    ),
    "derived": (
        {"kp": 5000, "more": 'kv="50"'},
        "d.ctrl[0] = 0\nmujoco.mj_step(m, d)\nm.body_mass[3] *= 20\nmujoco.mj_setConst(m, d)\n"
        "mujoco.mj_step(m, d)\n",
        None,
        None,
    ),
}


@pytest.mark.parametrize("case", some(ANSWERED, 1))
def test_what_is_asked_and_not_got_is_said(tmp_path: Path, case: str) -> None:
    how, text, code, reason = ANSWERED[case]
    model = ARM.format(**{"at": 0.2, "child": "link1", **how})
    found = told(tmp_path, model + text).analysis.findings
    expected = [] if code is None else [(code, reason)]
    if case == "stiff":
        expected += [("auto-reset", None)]
        assert "kp h²/I" in found[0].message
    assert [(each.code, each.reason) for each in found] == expected
    if case == "edited":
        assert found[0].site == "script.py:14"

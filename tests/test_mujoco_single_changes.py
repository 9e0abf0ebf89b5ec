"""Single changes tried on a MuJoCo run: bitwise equal to the user's own edit of the script.

Verification: a run with a change equals a bare run of MuJoCo whose model, state or inputs were
edited by hand; the script still reads its own.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

mujoco = pytest.importorskip("mujoco")

import numpy as np  # noqa: E402
from drop_physics.engines.cures import TABLES  # noqa: E402
from drop_physics.engines.mujoco.watch.derived import DERIVED  # noqa: E402
from drop_physics.engines.mujoco.watch.intervene import ModelChanges  # noqa: E402
from drop_physics.engines.mujoco.watch.seen import SeenInputs  # noqa: E402
from drop_physics.engines.mujoco.watch.single_changes import possible, trial_of  # noqa: E402
from drop_physics.engines.mujoco.watch.writes import sizes  # noqa: E402
from drop_physics.engines.watching.single_changes import Change  # noqa: E402

SCENE = """<mujoco><option timestep="0.002" density="1.2" iterations="1"/><worldbody>
  <geom name="floor" type="plane" size="5 5 1" friction="0.6"/>
  <body name="box" pos="0 0 0.12"><freejoint name="box"/>
    <geom name="box" type="box" size="0.1 0.1 0.1" mass="1" friction="0.4" margin="0.001"/></body>
  <body name="ball" pos="0 0 0.33"><freejoint/>
    <geom name="ball" size="0.1" pos="0.01 0 0" mass="0.5"/></body>
  <body name="arm" pos="0 1 1"><joint name="elbow" axis="0 1 0" damping="0.1" stiffness="2"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2"/>
    <body name="hand" pos="0.3 0 0"><joint name="wrist" axis="0 1 0" range="-1 1"
      limited="true" pos=".01 0 0"/>
      <geom name="hand" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="1"/></body></body>
  <body name="lid" pos="1 0 1"><freejoint/><geom size="0.05" mass="0.1"/></body></worldbody>
<equality><weld name="held" body1="lid"/></equality>
<actuator><position name="servo" joint="elbow" kp="20" kv="1"/>
  <velocity name="spin" joint="wrist" kv="0.5"/><motor name="push" joint="wrist" gear="3"/>
</actuator></mujoco>"""
MUJOCO = TABLES["MuJoCo"]
ROWS = MUJOCO.tried
STEPS = 60


def scripted(_: Any, d: Any, step: int) -> None:
    """Set inputs before each step, as a script does."""
    d.ctrl[:] = [0.3 + 0.01 * step, 0.2, 0.1]
    d.xfrc_applied[1, 0] = 0.5
    if step % 20 == 10:
        d.qvel[-1] = 0.25


class Script:
    """A script whose calls of mujoco are watched; `changed` applies from a step on."""

    def __init__(self, *operations: dict[str, Any]) -> None:
        self.fired: set[int] = set()
        sites = SimpleNamespace(place=lambda _: ("a.py", 1), outside=lambda frame: frame)
        host = SimpleNamespace(sites=sites, forks=None, standing=lambda _, call: call)
        originals = {"mj_setConst": mujoco.mj_setConst}
        watch: Any = SimpleNamespace(host=host, mujoco=mujoco, originals=originals, uncounted=set())
        tagged = [{"engine": "mujoco", **each} for each in operations]
        self.changes = ModelChanges(watch, tagged, {}, self.fired.add)
        self.step = self.changes.around("mj_step", lambda m, d: mujoco.mj_step(m, d))
        self.changes.around("mj_forward", mujoco.mj_forward)
        self.m = mujoco.MjModel.from_xml_string(SCENE)
        self.d = mujoco.MjData(self.m)

    def become(self, change: Change) -> None:
        """Continue with a change."""
        trial = json.loads(json.dumps(trial_of(change)))
        self.changes.become(trial["interventions"], trial["variation"])

    def run(self, first: int = 0, last: int = STEPS) -> Any:
        """Make steps, and return the state after each."""
        states = []
        for step in range(first, last):
            scripted(self.m, self.d, step)
            self.step(self.m, self.d)
            states.append([*self.d.qpos, *self.d.qvel])
        return np.array(states)


def bare(edit: Callable[[Any, Any], object], *, script: Any = scripted, finer: int = 1) -> Any:
    """Return the states of a MuJoCo run without drop, edited before the first step."""
    m = mujoco.MjModel.from_xml_string(SCENE)
    d = mujoco.MjData(m)
    edit(m, d)
    states = []
    for step in range(STEPS):
        script(m, d, step)
        for _ in range(finer):
            mujoco.mj_step(m, d)
        states.append([*d.qpos, *d.qvel])
    return np.array(states)


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, str], Change]:
    """Return the possible changes of the script, by target and kind of change."""
    own = Script({"do": "see"})
    states = own.run()
    assert states.tobytes() == bare(nothing).tobytes()
    (seen,) = own.changes.seen.values()
    changes = possible(mujoco, ROWS, seen)
    return {(each.change, each.op): each for each in changes}


def nothing(_: Any, __: Any) -> None:
    """Leave the model unedited."""


def set_const(m: Any) -> None:
    mujoco.mj_setConst(m, mujoco.MjData(m))


def scaled(m: Any, field: str, factor: float, where: Any = ..., *, derived: bool = False) -> None:
    getattr(m, field)[where] *= factor
    if derived:
        set_const(m)


def heavier(m: Any, factor: float) -> None:
    scaled(m, "body_mass", factor)
    scaled(m, "body_inertia", factor, derived=True)


def stiffer_servo(m: Any, factor: float) -> None:
    m.actuator_gainprm[0, 0] *= factor
    m.actuator_biasprm[0, 1] *= factor


def stiffer_damper(m: Any, factor: float) -> None:
    m.actuator_biasprm[:2, 2] *= factor
    m.actuator_gainprm[1, 0] *= factor


def without_equality(_: Any, d: Any) -> None:
    d.eq_active[:] = 0


def higher(_: Any, d: Any) -> None:
    d.qpos[[2, 9, 18]] += 0.01


def inertia_more(m: Any) -> None:
    m.dof_damping[:] += 10 * m.dof_M0


def apart(m: Any) -> None:
    """Disable all collisions of the three touching geoms, which equals disabling each pair."""
    for name in ("floor", "box", "ball"):
        m.geom(name).contype = m.geom(name).conaffinity = 0


EDITS: dict[tuple[str, str], Callable[[Any, Any], object]] = {
    ("dof_damping", "*10"): lambda m, _: scaled(m, "dof_damping", 10),
    ("dof_damping", "+10M0"): lambda m, _: inertia_more(m),
    ("jnt_limited", "=0"): lambda m, _: m.jnt_limited.__setitem__(..., 0),
    ("jnt_axis", "*-1"): lambda m, _: scaled(m, "jnt_axis", -1),
    ("geom_friction", "*10"): lambda m, _: scaled(m, "geom_friction", 10),
    ("geom_friction", "=default"): lambda m, _: m.geom_friction.__setitem__(..., (1, 5e-3, 1e-4)),
    ("geom_condim", "=6"): lambda m, _: m.geom_condim.__setitem__(..., 6),
    ("geom_solref", "stiff"): lambda m, _: m.geom_solref.__setitem__(..., (0.004, 1)),
    ("geom_pos", "=0"): lambda m, _: (
        m.geom_pos.__setitem__(..., 0),
        m.geom_sameframe.__setitem__(..., 0),
    ),
    ("jnt_pos", "=0"): lambda m, _: scaled(m, "jnt_pos", 0, derived=True),
    ("pair", "=0"): lambda m, _: apart(m),
    ("geom_collides", "=0"): lambda m, _: apart(m),
    ("body_mass", "*0.1"): lambda m, _: heavier(m, 0.1),
    ("body_inertia", "*10"): lambda m, _: scaled(m, "body_inertia", 10, derived=True),
    ("actuator_kp", "*10"): lambda m, _: stiffer_servo(m, 10),
    ("actuator_kv", "*0.1"): lambda m, _: stiffer_damper(m, 0.1),
    ("actuator_gear", "*10"): lambda m, _: scaled(m, "actuator_gear", 10, derived=True),
    ("eq_active", "=0"): without_equality,
    ("option.iterations", "*10"): lambda m, _: setattr(m.opt, "iterations", 10),
    ("option.gravity", "=0"): lambda m, _: m.opt.gravity.__setitem__(..., 0),
    ("option.integrator", "=3"): lambda m, _: setattr(m.opt, "integrator", 3),
    ("option.density", "=0"): lambda m, _: setattr(m.opt, "density", 0),
    ("flag.CONTACT", "^"): lambda m, _: setattr(m.opt, "disableflags", 1 << 4),
    ("start.qpos", "+0.01"): higher,
}


@pytest.mark.parametrize("key", EDITS, ids="".join)
def test_a_change_is_the_edit_that_a_user_would_make(
    found: dict[tuple[str, str], Change], key: tuple[str, str]
) -> None:
    run = Script()
    before = {name: np.array(getattr(run.m, name)) for name in ("body_mass", "geom_friction")}
    run.become(found[key])
    states = run.run()
    assert run.fired
    assert states.tobytes() == bare(EDITS[key]).tobytes()
    assert states.tobytes() != bare(nothing).tobytes()
    for name, held in before.items():  # the script reads its own
        assert np.array_equal(getattr(run.m, name), held)


def test_a_model_edited_in_place_may_be_completed_by_mj_set_const(
    found: dict[tuple[str, str], Change],
) -> None:
    """Its own stale fields are one change, and no part of others."""
    assert ("model.derived", "derive") not in found

    def edit(m: Any, _: Any) -> None:
        m.body_mass[1] *= 3
        m.geom_size[1] *= 0.5

    own = Script({"do": "see"})
    edit(own.m, own.d)
    states = own.run()
    (seen,) = own.changes.seen.values()
    changes = {(each.change, each.op): each for each in possible(mujoco, ROWS, seen)}
    for key, trial in (
        (("model.derived", "derive"), lambda m, d: (edit(m, d), set_const(m))),
        (("body_inertia", "*10"), lambda m, d: (edit(m, d), scaled(m, "body_inertia", 10))),
    ):
        run = Script()
        edit(run.m, run.d)
        before = {name: np.array(getattr(run.m, name)) for name in DERIVED}
        run.become(changes[key])
        assert run.run().tobytes() == bare(trial).tobytes() != states.tobytes()
        assert all(np.array_equal(getattr(run.m, name), held) for name, held in before.items())


def test_quaternions_of_the_first_state_are_tried_with_w_first() -> None:
    """The script writes w last; a body without a turn stays as it is."""
    last, first = (0.6, 0.0, 0.0, 0.8), (0.8, 0.6, 0.0, 0.0)
    own, run, ended = Script({"do": "see"}), Script(), Script()
    for each, turned in ((own, last), (run, last), (ended, first)):
        each.d.qpos[3:7] = turned
    states = own.run()
    (seen,) = own.changes.seen.values()
    changes = possible(mujoco, ROWS, seen)
    (change,) = (each for each in changes if each.op == "w-first")
    run.become(change)
    assert run.run().tobytes() == ended.run().tobytes() != states.tobytes()


def late(m: Any, d: Any, step: int) -> None:
    scripted(m, d, step)
    d.ctrl[:] = [0.3 + 0.01 * max(step - 1, 0), 0.2, 0.1]


def held(m: Any, d: Any, step: int) -> None:
    scripted(m, d, step)
    d.ctrl[:] = [0.3, 0.2, 0.1]


def exchanged(m: Any, d: Any, step: int) -> None:
    scripted(m, d, step)
    d.ctrl[:] = d.ctrl[[0, 2, 1]]


def in_reverse(m: Any, d: Any, step: int) -> None:
    scripted(m, d, step)
    d.ctrl[:] = d.ctrl[::-1].copy()


def tenfold(m: Any, d: Any, step: int) -> None:
    scripted(m, d, step)
    d.xfrc_applied[1, 0] *= 10


def untouched(m: Any, d: Any, step: int) -> None:
    velocity = d.qvel.copy()
    scripted(m, d, step)
    d.qvel[:] = velocity


INPUTS = {
    ("input.ctrl", "late"): late,
    ("input.ctrl", "held"): held,
    ("input.ctrl", "exchanged"): exchanged,  # of those that it can be of, the last two
    ("input.ctrl", "reversed"): in_reverse,
    ("input.xfrc_applied", "*10"): tenfold,
    ("input.qvel", "undone"): untouched,
}


@pytest.mark.parametrize("key", INPUTS, ids="".join)
def test_an_input_is_another_and_the_script_reads_its_own(
    found: dict[tuple[str, str], Change], key: tuple[str, str]
) -> None:
    run = Script()
    run.become(found[key])
    states = run.run()
    assert states.tobytes() == bare(nothing, script=INPUTS[key]).tobytes()
    assert run.d.ctrl[0] == 0.3 + 0.01 * (STEPS - 1)
    assert run.d.xfrc_applied[1, 0] == 0.5


def test_what_is_undone_is_not_how_the_script_begins(
    found: dict[tuple[str, str], Change],
) -> None:
    """Undoing a script's writes does not undo the initial pose and velocities."""

    def begins(_: Any, d: Any) -> None:
        d.qvel[-1] = 0.5

    run = Script()
    begins(run.m, run.d)
    run.become(found["input.qvel", "undone"])
    assert run.run().tobytes() == bare(begins, script=untouched).tobytes()


def test_a_finer_timestep_makes_so_many_steps(found: dict[tuple[str, str], Change]) -> None:
    run = Script()
    run.become(found["option.timestep", "/2"])
    finer = bare(lambda m, _: setattr(m.opt, "timestep", 0.001), finer=2)
    assert run.run().tobytes() == finer.tobytes()


def test_a_change_may_begin_at_any_step(found: dict[tuple[str, str], Change]) -> None:
    def later(m: Any, d: Any, step: int) -> None:
        scripted(m, d, step)
        if step == 25:
            scaled(m, "geom_friction", 0.1)
            heavier(m, 10)
            d.eq_active[:] = 0

    run = Script()
    first = run.run(last=25)
    keys = ("geom_friction", "*0.1"), ("body_mass", "*10"), ("eq_active", "=0")
    assert [MUJOCO.follows(found[key]) for key in keys] == ["", "mujoco.mj_setConst", ""]
    trials = [trial_of(found[key]) for key in keys]
    run.changes.become([one for each in trials for one in each["interventions"]], {})
    states = np.concatenate([first, run.run(25)])
    assert states.tobytes() == bare(nothing, script=later).tobytes()


def test_changes_are_those_that_change_something(found: dict[tuple[str, str], Change]) -> None:
    assert found["dof_damping", "*10"].of == ("elbow",)
    assert found["actuator_kp", "*10"].of == ("servo",)
    assert found["actuator_kv", "*10"].of == ("servo", "spin")
    assert found["pair", "=0"].of == ("floor x box", "box x ball")
    assert found["input.ctrl", "*10"].of == ("servo", "spin", "push")
    assert found["input.xfrc_applied", "*10"].of == ("box",)
    assert found["input.qvel", "undone"].of == ("lid",)
    assert found["geom_pos", "=0"].of == ("ball", "arm", "hand")
    assert found["jnt_axis", "*-1"].ids == (2, 3)
    absent = {("dof_armature", "*10"), ("option.wind", "=0"), ("tendon_limited", "=0")}
    absent |= {("start.qpos", "=default"), ("start.qvel", "=0"), ("input.qpos", "undone")}
    absent |= {("geom_condim", "=3"), ("body_gravcomp", "=0"), ("option.cone", "=0")}
    assert not absent & {*found}
    breaks = {change for (change, _), each in found.items() if each.breaks}
    assert {"body_mass", "flag.CONTACT", "option.gravity", "input.ctrl"} <= breaks
    assert not {"geom_friction", "dof_damping", "pair"} & breaks


def test_what_holds_a_robot_from_outside_takes_a_part_of_the_scene_away() -> None:
    """Braking a robot's unactuated base joint counts as support from outside; a door may brake."""
    scene = """<mujoco><worldbody><body name="torso"><joint name="rail" type="slide"/>
    <joint name="pitch" axis="0 1 0"/><geom size="0.1"/><body name="leg" pos="0 0 -0.3">
    <joint name="knee" axis="0 1 0"/><geom size="0.1"/></body></body>
    <body name="door" pos="1 0 0"><joint name="hinge"/><geom size="0.1"/></body></worldbody>
    <actuator><motor name="a" joint="knee"/></actuator></mujoco>"""
    m = mujoco.MjModel.from_xml_string(scene)
    seen = SeenInputs(m, mujoco.MjData(m))
    braked = [each for each in possible(mujoco, ROWS, seen) if each.op == "+10M0"]
    assert {each.of: each.breaks for each in braked} == {
        ("knee", "hinge"): False,
        ("rail", "pitch"): True,
    }


def test_a_change_of_some_elements_or_by_another_factor(
    found: dict[tuple[str, str], Change],
) -> None:
    some = found["geom_friction", "*10"].of_some([1]).by(2.0)
    assert some.of == ("box",)
    run = Script()
    run.become(some)
    expected = bare(lambda m, _: scaled(m, "geom_friction", 2, 1))
    assert run.run().tobytes() == expected.tobytes()
    with pytest.raises(ValueError, match="only a factor"):
        found["geom_friction", "=0"].by(2.0)


def test_another_model_has_other_elements(found: dict[tuple[str, str], Change]) -> None:
    """A change by index in one model does not exist in a model with other elements."""
    run = Script()
    run.become(found["geom_friction", "*10"])
    run.m = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    run.d = mujoco.MjData(run.m)
    assert sizes(run.m) != sizes(Script().m)
    run.step(run.m, run.d)
    assert not run.fired

"""Changes to a MuJoCo run: they apply inside steps, and the script reads its own values."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

mujoco = pytest.importorskip("mujoco")

from drop_physics.engines.mujoco.interventions import INTERVENTIONS  # noqa: E402
from drop_physics.engines.mujoco.watch.intervene import ModelChanges  # noqa: E402
from drop_physics.errors import ScenarioError  # noqa: E402
from drop_physics.stages.rerun.asked import cures_of  # noqa: E402
from drop_physics.stages.trust import USUAL, candidates_of, trust  # noqa: E402
from drop_physics.stages.why import why  # noqa: E402
from drop_physics.trace.cures import Cure, Scope  # noqa: E402
from drop_physics.trace.events import Actuator, Body, Joint  # noqa: E402

NO_GRAVITY = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
CORPUS = Path(__file__).parent / "corpus/mujoco/scripts"
SCENE = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 1"/>
  <body name="low" pos="0 0 0.1"><freejoint/>
    <geom name="low" type="box" size="0.1 0.1 0.1" mass="1"/></body>
  <body name="high" pos="0 0 0.3"><freejoint/>
    <geom name="high" type="box" size="0.1 0.1 0.1" mass="1"/></body>
  <body name="arm" pos="0 1 1"><joint name="elbow" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2"/></body></worldbody>
<actuator><position name="servo" joint="elbow" kp="20"/></actuator>
<contact>{pair}</contact>
<keyframe><key qpos="0 0 0.1 1 0 0 0 0 0 0.3 1 0 0 0 0.5" ctrl="0.7"/></keyframe></mujoco>"""


class RunChanged:
    """A model whose mujoco functions apply trial changes."""

    def __init__(
        self, *operations: dict[str, Any], pair: str = "", at: Any = None, **variation: Any
    ) -> None:
        self.fired: list[int] = []
        self.inside: list[float] = []
        """The timestep in effect during each step."""
        sites = SimpleNamespace(place=lambda _: ("a.py", at.line), outside=lambda frame: frame)
        self.host: Any = SimpleNamespace(sites=sites, forks=None, standing=lambda _, call: call)
        originals = {"mj_setConst": mujoco.mj_setConst}
        watch: Any = SimpleNamespace(
            host=self.host,
            mujoco=mujoco,
            originals=originals,
            uncounted=set(),
        )
        given = [{"engine": "mujoco", **operation} for operation in operations]
        self.changes = ModelChanges(watch, given, variation, self._tell)
        calls: dict[str, Callable[..., Any]] = {"mj_step": self._step}
        others = "mj_step1", "mj_step2", "mj_forward", "mj_resetData"
        calls |= {name: getattr(mujoco, name) for name in others}
        self.call = {name: self.changes.around(name, each) for name, each in calls.items()}
        self.m = mujoco.MjModel.from_xml_string(SCENE.format(pair=pair))
        self.d = mujoco.MjData(self.m)

    def _tell(self, number: int) -> None:
        if number not in self.fired:
            self.fired.append(number)

    def _step(self, m: Any, d: Any) -> None:
        self.inside.append(m.opt.timestep)
        mujoco.mj_step(m, d)

    def steps(self, count: int) -> None:
        """Make a number of the script's steps."""
        for _ in range(count):
            self.call["mj_step"](self.m, self.d)

    def height(self, body: str) -> float:
        """Return the height of a body."""
        return float(self.d.body(body).xpos[2])


FRICTIONS = [("geom", 0), ("pair", 0), ("pair", 1)]
"""Places where a coefficient of friction is written: geoms, and pairs in both orders."""


def test_a_finer_timestep_is_seen_by_steps_alone() -> None:
    run = RunChanged(finer=4)
    run.call["mj_step"](run.m, run.d, nstep=2)
    assert run.inside == [0.0005] * 8
    assert run.m.opt.timestep == 0.002
    assert run.d.time == pytest.approx(0.004, abs=1e-15)
    run.m.opt.timestep = 0.004  # the script's own still counts
    run.steps(1)
    assert run.inside[-4:] == [0.001] * 4


def test_a_nudge_moves_each_joint_once() -> None:
    run = RunChanged(nudge=1e-9)
    run.m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    before = run.d.qpos.copy()
    run.steps(1)
    bare = mujoco.MjData(run.m)
    mujoco.mj_step(run.m, bare)
    moved = abs(run.d.qpos - bare.qpos)
    assert moved[:3].min() > 0
    assert 0 < moved[3:7].max() < 1e-9, "it is turned, too"
    assert moved.max() < 3e-9
    assert moved[-1] > 0
    assert before[-1] == 0


def test_what_is_written_is_the_script_s_own_again_after_the_call() -> None:
    gain = {"do": "write", "of": "joint", "names": ["elbow"], "how": ["=", 5.0]}
    twice = INTERVENTIONS.applied(Cure("mass", value=2.0, form="factor"), Scope([]))
    assert twice is not None
    run = RunChanged({**gain, "field": "actuator_gainprm[0]"}, *twice.operations)
    run.m.actuator_gainprm[0, 0] = 7.0
    run.d.ctrl[0] = 1.0
    run.call["mj_forward"](run.m, run.d)
    assert run.d.actuator_force[0] == 5.0
    assert run.d.qfrc_bias[0] == 0
    assert run.d.qfrc_bias[2] == pytest.approx(2 * 9.81)
    assert run.m.actuator_gainprm[0, 0] == 7.0
    assert run.m.body_mass[1] == 1.0
    bare = mujoco.MjModel.from_xml_string(SCENE.format(pair=""))
    assert (run.m.body_invweight0 == bare.body_invweight0).all()
    assert sorted(run.fired) == [0, 1, 2]


@contextmanager
def _standing(*operations: dict[str, Any], pair: str = "") -> Iterator[RunChanged]:
    run = RunChanged(*operations, pair=pair)
    run.steps(300)
    yield run
    assert run.fired == [0]


def test_two_bodies_that_met_part_and_meet_all_else() -> None:
    with _standing({"do": "part", "names": [["low"], ["high"]]}) as run:
        assert run.height("low") == pytest.approx(0.1, abs=1e-3)
        assert run.height("high") == pytest.approx(0.1, abs=1e-3)


def test_two_bodies_that_are_kept_apart_meet() -> None:
    pair = '<exclude body1="low" body2="high"/>'
    with _standing({"do": "unexclude", "names": [["high"], ["low"]]}, pair=pair) as run:
        assert run.height("high") == pytest.approx(0.3, abs=1e-3)
    run = RunChanged({"do": "meet", "names": [["low"], ["high"]]})
    run.m.geom_contype[:] = run.m.geom_conaffinity[:] = [1, 1, 2, 0]
    run.steps(300)
    assert run.height("high") == pytest.approx(0.3, abs=1e-3)
    assert run.m.geom_contype.tolist() == [1, 1, 2, 0]


def test_states_are_written_where_the_script_leaves_them() -> None:
    run = RunChanged({"do": "key"})
    run.d.qpos[:] = run.m.key_qpos[0]
    run.steps(1)
    assert run.d.ctrl[0] == 0.7
    assert run.fired == [0]
    run = RunChanged({"do": "clear", "part": "xfrc_applied"})
    run.d.xfrc_applied[1, 0] = 8.0
    run.steps(1)
    assert not run.d.xfrc_applied.any()
    assert not run.fired
    run.steps(1)
    assert run.fired == [0]
    run = RunChanged({"do": "leave", "part": "ctrl"})
    run.d.ctrl[0] = 0.0
    run.steps(1)  # how the script begins stays
    run.d.ctrl[0] = 1.0
    run.steps(1)
    assert run.d.ctrl[0] == 0.0
    assert run.fired == [0]


def test_joints_that_are_placed_are_held_there() -> None:
    run = RunChanged({"do": "hold"})
    run.d.ctrl[0] = 1.0
    run.steps(2)
    assert run.d.ctrl[0] == 1.0
    run.d.qpos[-1] = 0.25
    run.call["mj_forward"](run.m, run.d)
    run.steps(1)
    assert run.d.ctrl[0] == 0.25
    assert run.fired == [0]


def test_what_a_reset_clears_is_given_again() -> None:
    run = RunChanged({"do": "give"})
    run.d.ctrl[0] = 1.0
    run.steps(2)
    run.call["mj_resetData"](run.m, run.d)
    assert run.d.ctrl[0] == 1.0
    assert run.fired == [0]


def test_a_run_that_becomes_a_trial_differs_from_its_first_call_on() -> None:
    run, parted = RunChanged(), [True]

    def stop(*, steps: bool) -> None:
        assert steps
        if parted.pop():
            run.changes.become([], {"finer": 2})
            parted.append(False)

    run.host.forks = SimpleNamespace(stop=stop)
    run.steps(1)
    assert run.inside == [0.001] * 2


def test_usual_variations_are_those_of_the_engine_that_the_model_has_not() -> None:
    usual = cures_of(USUAL, "--vary", whole=True)

    def names(engine: str, **held: float) -> set[str]:
        seen: Any = SimpleNamespace(
            engine=engine,
            bodies={},
            settings=[SimpleNamespace(values={"fixedTimeStep": 0.002, **held})],
        )
        known: Any = SimpleNamespace(seen=seen, possible=list)
        found = candidates_of(known, usual, "--vary", usual=True)
        with pytest.raises(ScenarioError, match=f"no option of {engine}"):
            candidates_of(known, usual, "--vary", usual=False)
        return {each.intervention.call for each in found}

    assert names("MuJoCo 4.0.0", solver=2.0, cone=0.0, impratio=1.0) == {
        *("timestep/2", "timestep/4", "iterations*4", "nudge", "seed"),
        *("solver=CG", "cone=elliptic", "impratio=10"),
    }
    assert names("PyBullet") == {
        *("timestep/2", "timestep/4", "iterations*4", "residual 0", "nudge", "seed")
    }


def test_a_mass_takes_its_inertia_along_and_a_flag_is_cleared() -> None:
    run = RunChanged(
        {"do": "weigh", "names": ["low"], "mass": 5.0, "factor": 10.0, "derived": True},
        {"do": "write", "field": "opt.disableflags", "how": ["~", "mjDSBL_GRAVITY"]},
    )
    run.m.opt.disableflags |= NO_GRAVITY
    inertia = float(run.m.body_inertia[1, 0])
    run.d.xfrc_applied[1, 3] = 1.0
    run.d.qpos[2] = 3.0
    run.steps(1)
    assert run.d.qvel[3] == pytest.approx(0.002 / (5 * inertia))
    assert run.d.qvel[2] == pytest.approx(-9.81 * 0.002)
    assert run.m.body_mass[1] == 1.0
    assert run.m.opt.disableflags & NO_GRAVITY
    assert sorted(run.fired) == [0, 1]


def test_a_contact_bounces_as_it_is_asked_to() -> None:
    run = INTERVENTIONS.applied(Cure("restitution", "0_arm", 0.8), Scope([_arm()]))
    assert run is not None
    soft = "solref='{:g} {:g}' priority='1'".format(*run.operations[0]["how"][1])
    m = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><geom type='plane' size='1 1 1' {soft}/><body pos='0 0 1'>"
        "<freejoint/><geom size='.05'/></body></worldbody></mujoco>"
    )
    d, speeds = mujoco.MjData(m), list[float]()
    for _ in range(350):
        mujoco.mj_step(m, d)
        speeds.append(float(d.qvel[2]))
    assert max(speeds) == pytest.approx(-0.8 * min(speeds), rel=0.03)


def test_a_write_is_left_out_before_its_line_alone() -> None:
    here = SimpleNamespace(line=1)
    run = RunChanged({"do": "keep", "field": "geom_friction", "site": ["a.py", 2]}, at=here)
    run.steps(1)
    run.m.geom_friction[1, 0] = 0.3
    run.steps(1)
    assert run.m.geom_friction[1, 0] == 0.3
    here.line = 2
    run.m.geom_friction[1, 0] = 0.9
    run.steps(1)
    assert run.m.geom_friction[1, 0] == 0.3
    assert run.fired == [0]
    run = RunChanged({"do": "skip", "function": "mj_forward", "site": ["a.py", 2]}, at=here)
    run.call["mj_forward"](run.m, run.d)
    assert not run.d.xpos[1].any()
    assert run.fired == [0]


def _arm() -> Body:
    servo = Actuator("servo", 0, "position", "joint", "elbow", 2.0, 20.0, 0.0, None, (-3.0, 3.0))
    joint = Joint(0, "elbow", "revolute", -1, (1, 1, 1))
    return Body(
        0, "0_arm", "arm", 3, 0, ("world", "arm"), (joint,), (0,), False, (), actuators=(servo,)
    )


@pytest.mark.parametrize(
    ("cure", "call", "operations"),
    [
        (
            Cure("gains", "elbow", 2.5, form="kp-below"),
            'kp="2"',
            [("actuator_gainprm[0]", "=", 2.0), ("actuator_biasprm[1]", "=", -2.0)],
        ),
        (
            Cure("forcerange", "elbow", 8.0),
            'forcerange="-8 8"',
            [
                ("jnt_actfrcrange[0]", "<", -8.0),
                ("jnt_actfrcrange[1]", ">", 8.0),
                ("actuator_forcerange[0]", "<", -4.0),
                ("actuator_forcerange[1]", ">", 4.0),
            ],
        ),
        (
            Cure("friction", "0_arm", 0.4, form="above"),
            'friction="0.8"',
            [(f"{kind}_friction[{column}]", ">", 0.8) for kind, column in FRICTIONS],
        ),
        (
            Cure("friction", "0_arm", 6.0, form="condim"),
            'condim="6"',
            [("geom_condim", "=", 6), ("pair_dim", "=", 6)],
        ),
        (
            Cure("friction", "elbow", 0.0, form="loss"),
            'frictionloss="0"',
            [("dof_frictionloss", "=", 0.0)],
        ),
        (
            Cure("impratio", None, 10.0),
            'cone="elliptic" impratio="10"',
            [("opt.impratio", "=", 10.0), ("opt.cone", "=", 1)],
        ),
    ],
)
def test_a_cure_is_written_as_an_attribute_and_made_with_its_number(
    cure: Cure, call: str, operations: list[tuple[str, str, float]]
) -> None:
    run = INTERVENTIONS.applied(cure, Scope([_arm()], "elbow" if cure.target == "elbow" else None))
    assert INTERVENTIONS.call_of(cure) == call
    assert run is not None
    found = [(operation["field"], *operation["how"]) for operation in run.operations]
    assert found == operations


def test_every_intervention_has_a_name_and_a_call() -> None:
    silent = {name for name, row in INTERVENTIONS.rows.items() if not row.words}
    factors = {f"{name}:factor" for name in ("gravity", "friction", "mass")}
    assert silent == {"iterations", "nudge", "seed", "parameter", *factors}


@pytest.mark.long
def test_each_statement_of_a_script_that_sets_something_is_left_out(tmp_path: Path) -> None:
    """The push moves the box, friction of a body in the air does nothing, to the bit."""
    script = tmp_path / "script.py"
    scene = "<mujoco><worldbody><body name='box'><freejoint/><geom size='.1'/></body></worldbody>"
    script.write_text(
        f"""import mujoco
m = mujoco.MjModel.from_xml_string("{scene}</mujoco>")
d = mujoco.MjData(m)
m.geom_friction[:] = 0.3
for step in range(50):
    d.xfrc_applied[1, 0] = 5
    mujoco.mj_step(m, d)
"""
    )
    found = why(str(script), out=tmp_path, ablate=True, jobs=1)
    assert [(each.call, each.site) for each in found.no_effect] == [
        ("without m.geom_friction[:] = 0.3", "script.py:4")
    ]
    (first, *_) = found.hangs_on
    assert first.intervention.call == "without d.xfrc_applied[1, 0] = 5"
    assert first.intervention.site == "script.py:6"
    mass = 4 / 3 * 3.141592653589793 * 0.1**3 * 1000
    assert first.moved is not None
    assert first.moved.value == pytest.approx(5 / mass * 0.002**2 * 50 * 51 / 2, rel=1e-3)


@pytest.mark.long
def test_why_cures_by_what_the_sum_says(tmp_path: Path) -> None:
    """Lowering kp to 1 removes all of 250 automatic resets, as `drop why` finds."""
    found = why(str(CORPUS / "gain_explodes.py"), out=tmp_path, jobs=1)
    by_code = {finding.finding.code: finding for finding in found.findings}
    assert by_code["unstable"].verdict == by_code["auto-reset"].verdict == "cured"
    (tried,) = by_code["unstable"].tried
    assert 1.5 < (tried.intervention.value or 0) * 0.8 < 2.4
    assert tried.intervention.call.startswith("kp=")


@pytest.mark.long
def test_trust_varies_a_script_s_model(tmp_path: Path) -> None:
    """By the corpus, an elliptic cone reduces 18.2 mm to about 9 mm, and impratio 10 to about 4."""
    script = CORPUS / "grasp_creeps.py"
    vary = ["cone=elliptic", "impratio=10", "nudge", "option.cone =1"]
    found = trust(str(script), out=tmp_path / "out", vary=vary, jobs=1)
    moved = {
        variation.name: max(end.value for end in variation.apart.end)
        for variation in found.variations
    }
    assert moved["nudge"] < 1e-7
    assert moved["cone=elliptic"] == pytest.approx(8.8e-3, abs=3e-4)
    assert moved["impratio=10"] == pytest.approx(14.1e-3, abs=5e-4)
    assert moved["option.cone =1"] == moved["cone=elliptic"], "as the search prints it"
    assert found.variations[0].term == "contacts"

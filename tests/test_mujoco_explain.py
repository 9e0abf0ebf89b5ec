"""MuJoCo's steps as sums of impulses, against MuJoCo itself and our own kinematics.

Verification: each step is replayed to the last bit, and the named impulses add up to the change of
momentum to rounding, with MuJoCo's mass matrix and with ours. What each is named after is compared
with what another of MuJoCo's functions says of it. `machine` has something of every kind.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from conftest import some
from drop_physics.engines.mujoco.explain.reasons import EXPLAINED, OTHER, REPLAYED
from drop_physics.engines.mujoco.explained import ReplayedPiece
from drop_physics.errors import DropError
from mujoco_scripts import MACHINE, Run, of_world, statuses, watched
from mujoco_trees import MujocoTrees

CLOSES = 1e-12
"""Tolerance for rounding, relative to the largest impulse."""

INTEGRATORS = ("EULER", "RK4", "IMPLICIT", "IMPLICITFAST")
OPTIONS = {
    "plain": "",
    "elliptic": "m.opt.cone = 1",
    "noslip": "m.opt.noslip_iterations = 4",
    "elliptic-noslip-sparse": "m.opt.cone, m.opt.noslip_iterations, m.opt.jacobian = 1, 4, 1",
    "sparse": "m.opt.jacobian = 1",
    "pgs": "m.opt.solver = 0",
    "cg": "m.opt.solver = 1",
    "eulerdamp-off": "m.opt.disableflags |= off.mjDSBL_EULERDAMP",
    "islands-off": "m.opt.disableflags |= off.mjDSBL_ISLAND",
    "no-springs": "m.opt.disableflags |= off.mjDSBL_SPRING",
    "no-dampers": "m.opt.disableflags |= off.mjDSBL_DAMPER",
    "no-gravity": "m.opt.disableflags |= off.mjDSBL_GRAVITY",
    "still-air": "m.opt.density = m.opt.viscosity = 0",
    "few-iterations": "m.opt.iterations = 1",
}
DRIVEN = """
import mujoco, numpy as np
off = mujoco.mjtDisableBit
def driven(m, steps, look=lambda *_: None):
    d = mujoco.MjData(m)
    rng = np.random.default_rng(1)
    d.qvel[:] = 0.3 * rng.standard_normal(m.nv)
    for k in range(steps):
        if k % 5 == 0:
            d.ctrl[:] = rng.uniform(-2, 2, m.nu)
        if k == 40:
            d.xfrc_applied[1] = [3, 1, 0, 0.1, 0, 0.2]
            d.xfrc_applied[m.nbody - 1] = [0, 2, 0, 0, 0.1, 0]
            d.qfrc_applied[:] = rng.uniform(-1, 1, m.nv)
        if k == 60:
            d.xfrc_applied[:] = 0
            d.mocap_pos[:, 0] += 0.1
        if k == 75:
            m.opt.timestep *= 0.5  # so that these steps are explained apart
        look(k, d)
        mujoco.mj_step(m, d)
"""
"""Every actuator is driven at random, and for a while forces are applied."""
STEPS = 120


def machine(folder: Path, runs: list[tuple[str, str]], steps: int = STEPS) -> Run:
    """Record the machine with each integrator and option, each in a simulation of its own."""
    made = "".join(
        f"m = mujoco.MjModel.from_xml_string(XML)\nm.opt.integrator = "
        f"mujoco.mjtIntegrator.mjINT_{integrator}\n{OPTIONS[option]}\ndriven(m, {steps})\n"
        for integrator, option in runs
    )
    return watched(folder, f"{DRIVEN}XML = '''{MACHINE}'''\n{made}")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, list[ReplayedPiece]]:
    """Return the machine's recording with each integrator."""
    run = machine(tmp_path_factory.mktemp("plain"), [(name, "plain") for name in INTEGRATORS])
    return run, run.explained()


Impulses = dict[tuple[str, int, int], np.ndarray]


def impulses_of(pieces: list[ReplayedPiece], world: int, nv: int) -> Impulses:
    """Return the impulses of each cause in all steps of a simulation, shape (STEPS, nv)."""
    found: Impulses = {}
    for piece in of_world(pieces, world):
        for cause, values in piece.impulses(nv).items():
            found.setdefault(cause, np.zeros((STEPS, nv)))[piece.steps] += values
    return found


def timesteps_of(m: Any) -> np.ndarray:
    """Return the timestep of each step [s], shape (STEPS, 1)."""
    return m.opt.timestep * np.where(np.arange(STEPS) < 75, 1.0, 0.5)[:, None]


def assert_closed(pieces: list[ReplayedPiece], world: int, steps: int) -> None:
    assert statuses(pieces, world) == [(EXPLAINED, "")] * steps
    for piece in of_world(pieces, world):
        assert piece.remainder.max() < CLOSES
        assert piece.largest.min() > 0


@pytest.mark.parametrize("world", range(4), ids=INTEGRATORS)
def test_every_step_is_replayed_and_its_sum_closes(
    plain: tuple[Run, list[ReplayedPiece]], world: int
) -> None:
    assert_closed(plain[1], world, STEPS)


@pytest.mark.parametrize("integrator", some(["EULER", "IMPLICITFAST"], 1))
def test_the_sum_closes_with_every_option(tmp_path: Path, integrator: str) -> None:
    run = machine(tmp_path, [(integrator, option) for option in OPTIONS], 80)
    pieces = run.explained()
    for world in range(len(OPTIONS)):
        assert_closed(pieces, world, 80)


def test_all_causes_are_met(plain: tuple[Run, list[ReplayedPiece]]) -> None:
    met = {(term.kind, term.first) for piece in plain[1] for term in piece.vocabulary.terms}
    kinds = {kind for kind, _ in met}
    assert kinds >= {
        *("gravity", "bias", "spring", "damper", "fluid", "gravity compensation", "tendon"),
        *("joint force range", "applied", "pushed", "equality", "friction loss", "limit"),
        *("tendon friction", "tendon limit", "push", "friction", "integrator", "solver"),
    }
    assert "passive callback" not in kinds
    assert {first for kind, first in met if kind == "actuator"} == set(range(7))
    assert {first for kind, first in met if kind == "equality"} == set(range(3))


@pytest.mark.parametrize("world", range(4), ids=INTEGRATORS)
def test_our_own_kinematics_find_the_same_change_of_momentum(
    plain: tuple[Run, list[ReplayedPiece]], world: int
) -> None:
    """Independent check: M (u' - u), computed without MuJoCo, is the sum of recorded impulses."""
    run, pieces = plain
    model = run.received.models[world]
    trees = MujocoTrees(model.arrays)
    assert trees.is_complete
    qpos, qvel = run.column("qpos", world), run.column("qvel", world)
    (first,) = [each for each in run.written(world) if each.cause == "first"]
    start = np.zeros(qvel.shape[1])
    wrote = [each for each in run.written(world) if "qvel" in each.parts]
    for each in wrote:
        start = each.parts["qvel"][1]
    before = np.vstack([start, qvel[:-1]])
    at = np.vstack([first.parts["qpos"][1], qpos[:-1]])
    momentum = trees.momentum(at, qvel - before)
    total = sum(impulses_of(pieces, world, qvel.shape[1]).values())
    scale = np.concatenate([piece.largest for piece in of_world(pieces, world)])
    assert (np.abs(momentum - total).max(axis=1) / scale).max() < CLOSES


class Reference:
    """MuJoCo's results for the state before each step, computed in a separate `MjData`."""

    def __init__(self, m: Any) -> None:
        self.m, self.d = m, mujoco.MjData(m)
        self.rows: list[dict[tuple[str, int, int], np.ndarray]] = []

    def look(self, _: int, d: Any) -> None:
        """Compute the forces in a state, each with another function than the code under test."""
        m, mine = self.m, self.d
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(m, spec))
        mujoco.mj_getState(m, d, state, spec)
        mujoco.mj_setState(m, mine, state, spec)
        mujoco.mj_forward(m, mine)
        found = {("gravity", -1, -1): self._gravity()}
        mujoco.mj_setState(m, mine, state, spec)
        mujoco.mj_forward(m, mine)
        moment = np.zeros((m.nu, m.nv))
        mujoco.mju_sparse2dense(
            moment,
            mine.actuator_moment,
            mine.moment_rownnz,
            mine.moment_rowadr,
            mine.moment_colind,
        )
        for actuator in range(m.nu):
            found["actuator", actuator, -1] = moment[actuator] * mine.actuator_force[actuator]
        for body in np.flatnonzero(mine.xfrc_applied.any(axis=1)).tolist():
            force = np.zeros(m.nv)
            push, turn = mine.xfrc_applied[body, :3], mine.xfrc_applied[body, 3:]
            mujoco.mj_applyFT(m, mine, push, turn, mine.xipos[body], body, force)
            found["pushed", body, -1] = force
        found |= self._contacts() | self._others()
        self.rows.append(found)

    def _gravity(self) -> np.ndarray:
        m, mine, force = self.m, self.d, np.zeros(self.m.nv)
        mine.qvel[:] = 0
        mujoco.mj_fwdPosition(m, mine)
        mujoco.mj_fwdVelocity(m, mine)
        mujoco.mj_rne(m, mine, 0, force)
        return -force

    def _contacts(self) -> dict[tuple[str, int, int], np.ndarray]:
        m, d = self.m, self.d
        found: dict[tuple[str, int, int], np.ndarray] = {}
        for index in range(d.ncon):
            contact = d.contact[index]
            if contact.efc_address < 0:
                continue
            force = np.zeros(6)
            mujoco.mj_contactForce(m, d, index, force)
            frame = contact.frame.reshape(3, 3)
            for kind, push, turn in (
                ("push", [force[0], 0, 0], [0, 0, 0]),
                ("friction", [0, force[1], force[2]], force[3:]),
            ):
                total = np.zeros(m.nv)
                for sign, geom in ((-1, contact.geom[0]), (1, contact.geom[1])):
                    part = np.zeros(m.nv)
                    mujoco.mj_applyFT(
                        m,
                        d,
                        sign * frame.T @ push,
                        sign * frame.T @ turn,
                        contact.pos,
                        m.geom_bodyid[geom],
                        part,
                    )
                    total += part
                key = kind, int(contact.geom[0]), int(contact.geom[1])
                found[key] = found.get(key, 0) + total
        return found

    def _others(self) -> dict[tuple[str, int, int], np.ndarray]:
        """Return the force of each remaining constraint row, keyed by kind."""
        m, d = self.m, self.d
        found: dict[tuple[str, int, int], np.ndarray] = {}
        kinds = ("equality", "friction loss", "tendon friction", "limit", "tendon limit")
        for row in range(d.nefc):
            kind = int(d.efc_type[row])
            if kind < len(kinds):
                alone = np.zeros(d.nefc)
                alone[row] = d.efc_force[row]
                force = np.zeros(m.nv)
                mujoco.mj_mulJacTVec(m, d, force, alone)
                number = int(d.efc_id[row])
                key = kinds[kind], int(m.dof_jntid[number]) if kind == 1 else number, -1
                found[key] = found.get(key, 0) + force
        return found


def test_each_impulse_is_what_its_name_says(plain: tuple[Run, list[ReplayedPiece]]) -> None:
    _, pieces = plain
    space: dict[str, Any] = {}
    exec(DRIVEN, space)
    model = mujoco.MjModel.from_xml_string(MACHINE)
    reference = Reference(model)
    space["driven"](model, STEPS, reference.look)
    model = mujoco.MjModel.from_xml_string(MACHINE)
    impulses = impulses_of(pieces, 0, model.nv)
    compared = {kind for row in reference.rows for kind, *_ in row}
    for key, values in impulses.items():
        if key[0] in compared:
            expected = [row.get(key, np.zeros(model.nv)) for row in reference.rows]
            forces = values / timesteps_of(model)
            np.testing.assert_allclose(
                forces, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max(), err_msg=str(key)
            )
    met = {key for row in reference.rows for key, force in row.items() if np.any(force)}
    assert met <= impulses.keys()


def test_springs_of_tendons_are_apart_from_those_of_joints(
    plain: tuple[Run, list[ReplayedPiece]],
) -> None:
    """A tendon without stiffness and damping leaves only the joints' springs and dampers."""
    model = mujoco.MjModel.from_xml_string(MACHINE)
    space: dict[str, Any] = {}
    exec(DRIVEN, space)
    rows: list[np.ndarray] = []
    mine = mujoco.MjData(model)

    def look(_: int, d: Any) -> None:
        forces = []
        held = model.tendon_stiffness.copy(), model.tendon_damping.copy()
        for without in ([], [0], [1], [0, 1]):
            model.tendon_stiffness[without] = model.tendon_damping[without] = 0
            mine.qpos[:], mine.qvel[:] = d.qpos, d.qvel
            mujoco.mj_forward(model, mine)
            forces.append(mine.qfrc_spring + mine.qfrc_damper)
            model.tendon_stiffness[:], model.tendon_damping[:] = held
        rows.append(np.array([forces[0] - forces[1], forces[0] - forces[2], forces[3]]))

    space["driven"](model, STEPS, look)
    first, second, joints = np.moveaxis(np.array(rows), 1, 0)
    timesteps = timesteps_of(mujoco.MjModel.from_xml_string(MACHINE))
    impulses = impulses_of(plain[1], 0, model.nv)
    found = [impulses["tendon", tendon, -1] for tendon in range(2)]
    found.append(impulses["spring", -1, -1] + impulses["damper", -1, -1])
    for values, forces in zip(found, (first, second, joints), strict=True):
        assert np.abs(forces).max() > 0.1
        np.testing.assert_allclose(values, forces * timesteps, atol=1e-13)


def test_contact_points_are_in_the_worlds_axes(plain: tuple[Run, list[ReplayedPiece]]) -> None:
    model = mujoco.MjModel.from_xml_string(MACHINE)
    space: dict[str, Any] = {}
    exec(DRIVEN, space)
    expected: list[tuple[Any, ...]] = []
    mine = mujoco.MjData(model)

    def look(step: int, d: Any) -> None:
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(model, spec))
        mujoco.mj_getState(model, d, state, spec)
        mujoco.mj_setState(model, mine, state, spec)
        mujoco.mj_forward(model, mine)
        for index in range(mine.ncon):
            contact, force = mine.contact[index], np.zeros(6)
            if contact.efc_address < 0:
                continue
            mujoco.mj_contactForce(model, mine, index, force)
            frame = contact.frame.reshape(3, 3)
            expected.append(
                (
                    step,
                    *contact.geom,
                    contact.friction.copy(),
                    contact.dist,
                    contact.pos.copy(),
                    frame[0].copy(),
                    frame.T @ force[:3],
                )
            )

    space["driven"](model, STEPS, look)
    touches = np.concatenate([piece.touches for piece in of_world(plain[1], 0)])
    assert len(touches) == len(expected) > 100
    largest = np.abs(touches["force_n"]).max()
    for touch, (*whole, friction, distance, position, normal, force) in zip(
        touches, expected, strict=True
    ):
        assert [touch["step"], touch["first"], touch["second"]] == whole
        np.testing.assert_array_equal(touch["friction"], friction)
        np.testing.assert_allclose(touch["distance_m"], distance, rtol=1e-6)
        np.testing.assert_allclose(touch["position_m"], position, atol=1e-6)
        np.testing.assert_allclose(touch["normal"], normal, atol=1e-6)
        np.testing.assert_allclose(touch["force_n"], force, atol=1e-6 * largest)


def test_a_recorded_state_that_differs_in_one_bit_is_not_explained(
    plain: tuple[Run, list[ReplayedPiece]],
) -> None:
    run, _ = plain
    first = run.frames[0]
    qpos = first.after["qpos"].copy()
    qpos.view(np.int64)[30, 0] ^= 1  # the lowest bit of the first coordinate
    frames = [replace(first, after={**first.after, "qpos": qpos}), *run.frames[1:]]
    pieces = replace(run, frames=frames).explained()
    expected = [(EXPLAINED, "")] * STEPS
    # The next step begins elsewhere, and comes elsewhere; then all is as before.
    expected[30] = expected[31] = (OTHER, "unknown")
    assert statuses(pieces, 0) == expected
    assert statuses(pieces, 1) == [(EXPLAINED, "")] * STEPS


TROUBLE = {
    "resets": """
for k in range(30):
    if k == 20: d.qvel[0] = 1e12
    mujoco.mj_step(m, d)
""",
    "flexible": """
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
<flexcomp name="f" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" radius="0.01" dim="2" mass="1">
</flexcomp></worldbody></mujoco>''')
d = mujoco.MjData(m)
for k in range(30): mujoco.mj_step(m, d)
""",
    "nothing moves": """
m = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
d = mujoco.MjData(m)
for k in range(30): mujoco.mj_step(m, d)
""",
}
if hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"):
    TROUBLE["discrete"] = """
m.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
for k in range(30): mujoco.mj_step(m, d)
"""
if hasattr(mujoco.mjtEnableBit, "mjENBL_SLEEP"):
    TROUBLE["sleeping"] = """
m = mujoco.MjModel.from_xml_string('''<mujoco><option><flag sleep="enable"/></option>
<worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 0.1"><freejoint/>
<geom type="box" size="0.1 0.1 0.1"/></body></worldbody></mujoco>''')
d = mujoco.MjData(m)
for k in range(600): mujoco.mj_step(m, d)
"""
if hasattr(mujoco.MjModel, "actuator_delay"):
    TROUBLE["delayed"] = """
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body><joint name="j"/>
<geom size="0.1" pos="0.1 0 0"/></body></worldbody><actuator>
<motor joint="j" delay="0.01" nsample="5"/></actuator></mujoco>''')
d = mujoco.MjData(m)
for k in range(30):
    d.ctrl[0] = k
    mujoco.mj_step(m, d)
"""
FALLING = """
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 0.3"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body></worldbody>
</mujoco>''')
d = mujoco.MjData(m)
"""


@pytest.mark.parametrize("name", some(TROUBLE, 2))
def test_what_has_no_sum_says_why(tmp_path: Path, name: str) -> None:
    run = watched(tmp_path, FALLING + TROUBLE[name])
    assert run.ending.how == "finished", run.said
    said = statuses(run.explained(), max(piece.world for piece in run.pieces))
    explained = (EXPLAINED, "")
    if name == "resets":
        assert said == [explained] * 20 + [(REPLAYED, "auto-reset")] + [explained] * 9
    elif name == "sleeping":
        awake = said.index((REPLAYED, "sleep"))
        assert said == [explained] * awake + [(REPLAYED, "sleep")] * (600 - awake)
        assert awake > 10
    else:
        reasons = {"discrete": "integrator", "flexible": "flex", "delayed": "delay"}
        assert said == [(REPLAYED, reasons.get(name, name))] * 30


def test_steps_are_replayed_by_their_own_version_alone(
    plain: tuple[Run, list[ReplayedPiece]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another version may misread a model's binary form, or crash."""
    run, _ = plain
    monkeypatch.setattr(run.received, "version", f"{mujoco.__version__}.1")
    with pytest.raises(DropError, match="while it replayed the script's steps"):
        run.explained()


def test_what_is_edited_in_place_counts_from_that_step_on(tmp_path: Path) -> None:
    """A heavier box weighs more at once; half the timestep gives half the impulse."""
    run = watched(
        tmp_path,
        FALLING
        + """
for k in range(30):
    if k == 10: m.body_mass[1] *= 3
    if k == 20: m.opt.timestep /= 2
    mujoco.mj_step(m, d)
""",
    )
    pieces = run.explained()
    assert_closed(pieces, 0, 30)
    weights = np.concatenate([piece.impulses(6)["gravity", -1, -1][:, 2] for piece in pieces])
    np.testing.assert_allclose(weights / weights[0], [1] * 10 + [3] * 10 + [1.5] * 10, rtol=1e-14)


def test_memory_does_not_grow_with_steps(tmp_path: Path) -> None:
    """Long runs are replayed in chunks of limited size."""
    run = watched(tmp_path, FALLING + "for k in range(3000): mujoco.mj_step(m, d)\n")
    sizes = [len(piece.status) for piece in run.explained()]
    assert sum(sizes) == 3000
    assert max(sizes) <= 512

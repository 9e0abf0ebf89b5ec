"""A MuJoCo recording has its model and a frame before each step: MuJoCo alone can replay it.

The judge here is MuJoCo itself, given nothing but what `reader` returns: from each frame, with its
inputs, one step must lead to the recorded state, to the last bit. No step knows of the one before.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from conftest import some
from drop_physics import record_script
from drop_physics.engines.mujoco.explain.loaded import load
from drop_physics.engines.mujoco.frames import STALE, STEPS, kind_of
from drop_physics.engines.mujoco.stepping import Stepper, StepsWanted
from drop_physics.errors import RecordingError
from drop_physics.recording import schema
from drop_physics.recording.reader import Recording, read
from drop_physics.trace.frames import FrameColumn, Frames, ModelEdit
from mujoco_scripts import MACHINE

BEGIN = f"""
import mujoco, numpy as np
XML = '''{MACHINE}'''
m = mujoco.MjModel.from_xml_string(XML)
d = mujoco.MjData(m)
rng = np.random.default_rng(0)
"""
RUNS = {
    "driven, pushed, reset and placed": """
d.qvel[:] = 0.3 * rng.standard_normal(m.nv)
for k in range(300):
    if k % 7 == 0: d.ctrl[:] = rng.uniform(-2, 2, m.nu)
    if k == 40: d.xfrc_applied[1, 2], d.qfrc_applied[3] = 3, 0.5
    if k == 80: d.qpos[0], d.act[0], d.mocap_pos[0, 2], d.time = 0.005, 0.3, 0.6, 7.25
    if k == 120: mujoco.mj_resetData(m, d)
    if k == 160: mujoco.mj_resetDataKeyframe(m, d, 0)
    if k == 200: d.eq_active[1] = 0
    mujoco.mj_step(m, d)
""",
    "a model that is edited": """
for k in range(200):
    if k == 50: m.opt.timestep, m.body_mass[2] = 0.001, 3.0
    if k in (90, 91): m.geom_friction[0, 0] = 0.1 * k
    if k == 130: m.opt.gravity[:] = 0, 1, -3
    mujoco.mj_step(m, d)
""",
    "in halves": """
for k in range(200):
    mujoco.mj_step1(m, d)
    d.ctrl[:] = rng.uniform(-1, 1, m.nu)
    mujoco.mj_step2(m, d)
""",
    "with stale positions": """
for k in range(60):
    mujoco.mj_step1(m, d)
    if k % 9 == 4: d.qpos[0] += 0.001
    mujoco.mj_step2(m, d)
""",
    "asleep": """
m = mujoco.MjModel.from_xml_string('''<mujoco><option><flag sleep="enable"/></option><worldbody>
<geom type="plane" size="5 5 1"/>
<body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
<body pos="0 0 0.5"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
<body pos="1 0 0.05"><freejoint/><geom type="box" size="0.05 0.05 0.05"/></body></worldbody>
</mujoco>''')
d = mujoco.MjData(m)
for k in range(400):
    if k == 300: d.xfrc_applied[3, 0] = 5
    mujoco.mj_step(m, d)
""",
    "over several pieces": """
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body><joint axis="0 1 0"/>
<geom size="0.1" pos="0.2 0 0"/><body pos="0.5 0 0"><joint type="ball"/>
<geom size="0.1" pos="0.2 0 0"/></body></body></worldbody></mujoco>''')
d = mujoco.MjData(m)
for k in range(9000):
    if k in (4095, 4096, 8192): d.qvel[0] += 1
    if k == 4097: d.qfrc_applied[0] = 0.01
    mujoco.mj_step(m, d)
""",
    "two states of one model, one of which changes it": """
other = mujoco.MjData(m)
other.qvel[0] = 1
for k in range(60):
    mujoco.mj_step(m, d)
    if k == 20: m.opt.gravity[2] = -5
    mujoco.mj_step(m, other)
""",
    "one state of two models": """
heavy = mujoco.MjModel.from_xml_string(XML.replace('density="800"', 'density="1800"'))
for k in range(60):
    mujoco.mj_step(m if k < 30 else heavy, d)
""",
}


def recorded(folder: Path, text: str, **how: Any) -> Recording:
    script = folder / "script.py"
    script.write_text(BEGIN + text)
    return read(record_script(str(script), out=folder / "run.rrd", explain=False, **how).recording)


def models_of(run: Recording) -> dict[int, Any]:
    made = {}
    for number, said in run.steps.models.items():
        binary = run.steps.model(number)
        assert said.engine == f"MuJoCo {mujoco.__version__}"
        assert (said.size, said.sha256) == (len(binary), hashlib.sha256(binary).hexdigest())
        made[number] = mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": binary})
    return made


def edit(m: Any, change: ModelEdit) -> None:
    owner, name = (m.opt, change.name[4:]) if change.name.startswith("opt.") else (m, change.name)
    held = getattr(owner, name)
    if isinstance(held, np.ndarray):
        held.reshape(-1)[change.indices] = change.values
    else:
        setattr(owner, name, type(held)(change.values[0]))


def step(m: Any, d: Any, frames: Frames, number: int) -> None:
    state, function = frames.state(number), int(frames.functions[number])
    (clock_s,) = state.pop("clock_s")
    whole = state | frames.given(number)
    if function & STALE:
        other = {n: c.rows[c.at == number][0] for n, c in frames.posed.items() if number in c.at}
        load(m, d, whole | other)
    else:
        load(m, d, whole)
    d.time = clock_s
    name = STEPS[function & 15]
    if name == "mj_step":
        mujoco.mj_step(m, d)
    else:
        assert name == "mj_step2"
        mujoco.mj_step1(m, d)
        load(m, d, whole)
        mujoco.mj_step2(m, d)


def redone(run: Recording) -> Iterator[tuple[int, int, bool]]:
    """Yield client, step, and whether MuJoCo's step from its frame gives the recorded state."""
    for client in run.steps.clients:
        (model,) = {frames.model for frames in run.steps.pieces(client, 0, 1 << 60)}
        m = models_of(run)[model]
        for frames in run.steps.pieces(client, 0, 1 << 60):
            for number in range(len(frames)):
                for change in frames.edits:
                    if change.step == number:
                        edit(m, change)
                d = mujoco.MjData(m)
                step(m, d, frames, number)
                same = d.time == frames.clock_s[number] and all(
                    np.array_equal(
                        getattr(d, name).reshape(-1).view(kind_of(name)).astype(float),
                        rows[number],
                        equal_nan=True,
                    )
                    for name, rows in frames.after.items()
                )
                yield client, frames.first + number, same


@pytest.mark.parametrize("name", some(RUNS, 1))
def test_each_step_is_taken_again_from_its_frame(name: str, tmp_path: Path) -> None:
    run = recorded(tmp_path, RUNS[name])
    made = [*redone(run)]
    assert [each for each in made if not each[2]] == []
    assert len(made) == sum(run.seen.samples.values()) - len(run.steps.clients) > 0
    assert len({(client, step) for client, step, _ in made}) == len(made)
    if name == "asleep":  # without what sleeps, steps lead elsewhere
        assert any((f.after["tree_asleep"] >= 0).any() for f in run.steps.pieces(0, 0, 1 << 60))


@pytest.mark.parametrize("name", some(RUNS, 2))
def test_a_stepper_takes_each_step_alone_and_leads_to_its_state(name: str, tmp_path: Path) -> None:
    """The replaying process receives whole chunks, and reproduces the script's states."""
    run, files = recorded(tmp_path, RUNS[name]), tmp_path / "models"
    files.mkdir()
    for number in run.steps.models:
        (files / str(number)).write_bytes(run.steps.model(number))
    with Stepper(sys.executable, mujoco.__version__) as stepper:
        for client in run.steps.clients:
            edits: list[ModelEdit] = []
            for frames in run.steps.pieces(client, 0, 1 << 60):
                end = min(len(frames), 300)
                wanted = StepsWanted(files / str(frames.model), frames, end // 3, end, edits)
                reached = stepper.states(wanted)
                edits += frames.edits
                for part, rows in reached.items():
                    expected = frames.clock_s if part == "clock_s" else frames.after[part]
                    np.testing.assert_array_equal(rows, expected[end // 3 : end], part)


def test_a_step_of_another_state_is_taken_too(tmp_path: Path) -> None:
    """The step starts from a state of ours, with inputs that the script never gave."""
    run = recorded(tmp_path, "for k in range(20): mujoco.mj_step(m, d)")
    path = tmp_path / "model.mjb"
    path.write_bytes(run.steps.model(0))
    (frames,) = run.steps.pieces(0, 0, 20)
    qvel = frames.after["qvel"].copy()
    qvel[9] += 0.01
    ctrl = FrameColumn(np.array([0, 10]), np.array([frames.given(0)["ctrl"], np.full(7, 0.5)]))
    other = replace(
        frames, after={**frames.after, "qvel": qvel}, inputs={**frames.inputs, "ctrl": ctrl}
    )
    with Stepper(sys.executable, None) as stepper:
        reached = stepper.states(StepsWanted(path, other, 10, 11))
    m = mujoco.MjModel.from_binary_path(str(path))
    d = mujoco.MjData(m)
    for part, row in frames.state(10).items():
        if part == "clock_s":
            d.time = row[0]
        else:
            getattr(d, part)[:] = row
    d.qvel[:], d.ctrl[:] = qvel[9], 0.5
    mujoco.mj_step(m, d)
    np.testing.assert_array_equal(reached["qpos"][0], d.qpos)
    np.testing.assert_array_equal(reached["qvel"][0], d.qvel)
    assert not np.array_equal(d.qvel, frames.after["qvel"][10])


def test_windows_are_read_alone(tmp_path: Path) -> None:
    run = recorded(tmp_path, RUNS["over several pieces"])
    whole = [*run.steps.pieces(0, 0, 9000)]
    assert [each.first for each in whole] == [0, 4096, 8192]
    assert [piece.first for piece in run.steps.pieces(0, 4096, 4097)] == [4096]
    assert [piece.first for piece in run.steps.pieces(0, 4095, 4097)] == [0, 4096]
    assert [*run.steps.pieces(0, 9000, 9001)] == [*run.steps.pieces(1, 0, 9000)] == []


def test_what_samples_hold_is_not_held_twice(tmp_path: Path) -> None:
    run = recorded(tmp_path, RUNS["over several pieces"])
    frames = next(run.steps.pieces(0, 0, 1))
    assert [each.columns.tolist() for each in frames.shared["qpos"]] == [[0]]  # a ball's are turned
    assert [each.columns.tolist() for each in frames.shared["qvel"]] == [[0]]


def test_a_model_is_held_once_and_only_if_it_is_stepped(tmp_path: Path) -> None:
    text = """
copy = mujoco.MjModel.from_xml_string(XML)
for each in (m, copy):
    mujoco.mj_step(each, mujoco.MjData(each))
seen = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
mujoco.mj_forward(seen, mujoco.MjData(seen))
"""
    run = recorded(tmp_path, text)
    assert [*run.steps.models] == [0]
    assert run.steps.clients == [0, 1]


@pytest.mark.long
def test_models_of_one_colour_are_recorded(tmp_path: Path) -> None:
    """100 models of a megabyte are recorded, most of whose bytes are equal."""
    flat = '<texture name="t" type="2d" builtin="flat" width="600" height="600"/>'
    body = '<body><freejoint/><geom size="%f"/></body>'
    xml = f"<mujoco><asset>{flat}</asset><worldbody>{body}</worldbody></mujoco>"
    made = f"    m = mujoco.MjModel.from_xml_string('{xml}' % (0.1 + k / 1000))\n"
    stepped = "    mujoco.mj_step(m, mujoco.MjData(m))\n"
    run = recorded(tmp_path, f"for k in range(100):\n{made}{stepped}")
    assert len(run.steps.models) == 100
    models_of(run)


def test_frames_are_covered_by_a_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = recorded(tmp_path, "mujoco.mj_step(m, d)")
    from drop_physics.recording import digest

    for entity, name in ((schema.STEPS, "add_steps"), (schema.MODELS, "add_model")):
        with monkeypatch.context() as patch:
            patch.setattr(digest.Digests, name, lambda *_: None)
            with pytest.raises(RecordingError, match=f"its section {entity} fails its checksum"):
                read(run.path)

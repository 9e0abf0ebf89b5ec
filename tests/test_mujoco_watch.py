"""Watching a MuJoCo script captures its steps, and changes nothing.

Verification: a script prints the same to the last bit with and without being watched; the states
sent are those that it reads itself; what it wrote without a call is found, between which lines.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import some
from drop_physics.engines.mujoco.explain.reasons import EXPLAINED, OTHER, REPLAYED
from drop_physics.engines.mujoco.frames import STALE, STEPS, UNPOSED
from drop_physics.engines.script import ELSEWHERE
from mujoco_scripts import bare, statuses, watched

SCENE = """
import json, mujoco, numpy as np
XML = '''<mujoco><worldbody><geom type="plane" size="5 5 1"/>
<body name="box" pos="0 0 0.15"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
<body name="arm" pos="1 0 1"><joint name="j" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/></body></worldbody>
<actuator><position name="p" joint="j" kp="20" forcerange="-3 3"/></actuator>
<keyframe><key name="lifted" qpos="0 0 0.3 1 0 0 0 0.5" ctrl="0.5"/></keyframe></mujoco>'''
m = mujoco.MjModel.from_xml_string(XML)
d = mujoco.MjData(m)
seen = []
def look(d=d):
    seen.append([*d.qpos, *d.qvel, d.time])
def tell():
    print(json.dumps(seen))
"""
"""A box on a plane, and an actuated arm."""

WAYS = {
    "mj_step": """
for k in range(20):
    mujoco.mj_step(m, d)
    look()
""",
    "from mujoco": """
from mujoco import mj_step
for k in range(20):
    mj_step(m, d)
    look()
""",
    "the package under another name": """
import importlib.util, sys
where = list(mujoco.__path__)
spec = importlib.util.spec_from_file_location(
    "other", mujoco.__file__, submodule_search_locations=where)
other = sys.modules["other"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(other)
from mujoco._functions import mj_step
for k in range(20):
    other.mj_step(m, d)
    look()
    mj_step(m, d)
    look()
""",
    "nstep": """
mujoco.mj_step(m, d, 3); mujoco.mj_step(m, d, nstep=4)
mujoco.mj_step(m=m, d=d, nstep=np.int64(2)); mujoco.mj_step(nstep=1, d=d, m=m)
mujoco.mj_step(m, d, nstep=0)
look()
""",
    "two halves": """
for k in range(20):
    mujoco.mj_step1(m, d)
    d.ctrl[0] = 0.1 * k + d.qpos[7]
    mujoco.mj_step2(m, d)
    look()
""",
    "integrators": """
for k in range(5):
    mujoco.mj_forward(m, d)
    mujoco.mj_Euler(m, d)
    look()
m.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
for k in range(5):
    mujoco.mj_forward(m, d)
    mujoco.mj_implicit(m, d)
    look()
for k in range(5):
    mujoco.mj_forward(m, d)
    mujoco.mj_RungeKutta(m, d, 4)
    look()
""",
    "callbacks": """
m = mujoco.MjModel.from_xml_string(XML.replace(
    "<keyframe>", '<sensor><user dim="1" needstage="vel"/></sensor><keyframe>'))
d, ahead = mujoco.MjData(m), mujoco.MjData(m)
mujoco.mj_step(m, ahead)
def control(m, d):
    if d is not ahead:
        ahead.qpos[:], ahead.qvel[:] = d.qpos, d.qvel
        mujoco.mj_step(m, ahead)
        mujoco.mj_forward(m, ahead)
        d.ctrl[0] = np.sin(50 * d.time) + ahead.qvel[6]
def passive(m, d):
    d.qfrc_passive[6] -= 0.3 * d.qvel[6] ** 3
def sensor(m, d, stage):
    d.qfrc_applied[6] = -0.1 * d.qvel[6]
mujoco.set_mjcb_sensor(sensor)
mujoco.set_mjcb_control(control)
assert mujoco.get_mjcb_control() is control
for k in range(10):
    mujoco.mj_step(m, d)
    look(d)
m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
for k in range(10):
    mujoco.mj_step(m, d)
    look(d)
mujoco.set_mjcb_control(None)
assert mujoco.get_mjcb_control() is None
mujoco.set_mjcb_passive(passive)
for k in range(10):
    mujoco.mj_step(m, d)
    look(d)
mujoco.set_mjcb_passive(None)
mujoco.set_mjcb_sensor(None)
""",
    "user actuators": """
m = mujoco.MjModel.from_xml_string(XML.replace(
    '<position name="p" joint="j" kp="20" forcerange="-3 3"/>',
    '<general joint="j" dyntype="user" actdim="1" gaintype="user" biastype="user"/>'
).replace('ctrl="0.5"', ''))
d = mujoco.MjData(m)
mujoco.set_mjcb_act_dyn(lambda m, d, i: d.ctrl[i] - d.act[i])
mujoco.set_mjcb_act_gain(lambda m, d, i: 2 + np.cos(d.time))
mujoco.set_mjcb_act_bias(lambda m, d, i: -0.1 * d.qvel[6])
for k in range(20):
    d.ctrl[0] = 1
    mujoco.mj_step(m, d)
    look(d)
for name in ("dyn", "gain", "bias"):
    getattr(mujoco, "set_mjcb_act_" + name)(None)
mujoco.mj_step(m, d)
look(d)
""",
}


@pytest.mark.parametrize("way", some({way: way for way in WAYS}, 1))
def test_every_way_to_step_is_seen_to_the_bit_and_explained(tmp_path: Path, way: str) -> None:
    text = f"{SCENE}{WAYS[way]}tell()\n"
    alone = bare(tmp_path / "bare", text)
    assert alone.returncode == 0, alone.stderr
    run = watched(tmp_path / "watched", text)
    assert run.printed == alone.stdout
    assert run.received.faults == []
    (rows,) = [np.array(eval(line)) for line in run.printed.splitlines()]
    world = max(piece.world for piece in run.pieces)
    sent = np.column_stack(
        [
            run.column("qpos", world),
            run.column("qvel", world),
            np.concatenate([piece.times_s for piece in run.pieces if piece.world == world]),
        ]
    )
    np.testing.assert_array_equal(sent[-len(rows) :], rows)
    assert statuses(run.explained(), world) == [(EXPLAINED, "")] * len(sent)


TRAPS = {
    "a model of its own for each step": """
import gc
for k in range(12):
    mujoco.mj_step(mujoco.MjModel.from_xml_string(XML.replace('kp="20"', f'kp="{k + 1}"')), d)
    gc.collect()
    look()
""",
    "a model swapped in the viewer's loop": """
import contextlib, mujoco.viewer
class Open(contextlib.nullcontext):
    __enter__ = lambda self: self
    sync, is_running = (lambda self: None), (lambda self: True)
for kp in (20, 40):
    m = mujoco.MjModel.from_xml_string(XML.replace('kp="20"', f'kp="{kp}"'))
    d = mujoco.MjData(m)
    with mujoco.viewer.launch_passive(m, d) as viewer:
        while viewer.is_running() and d.time < 0.011:
            mujoco.mj_step(m, d)
            viewer.sync()
            look(d)
""",
    "a model that is compiled again": """
spec = mujoco.MjSpec.from_string(XML)
m = spec.compile()
d = mujoco.MjData(m)
for k in range(6):
    mujoco.mj_step(m, d)
spec.body("arm").add_geom(size=[0.1, 0, 0], pos=[0.3, 0, 0], density=500)
m, d = spec.recompile(m, d)
for k in range(6):
    mujoco.mj_step(m, d)
    look(d)
""",
    "a state that was pickled": """
import pickle
for k in range(6):
    mujoco.mj_step(m, d)
d.ctrl[0] = 0.3
d = pickle.loads(pickle.dumps(d))
for k in range(6):
    mujoco.mj_step(m, d)
    look(d)
""",
    "a function of the script's own in place of mj_step": """
plain = mujoco.mj_step
def mj_step(m, d, nstep=1):
    d.ctrl[0] = d.qpos[7] + 0.1
    plain(m, d, nstep)
mujoco.mj_step = mj_step
for k in range(6):
    mujoco.mj_step(m, d, nstep=2)
    look()
""",
}
"""Script idioms that once made the recorder lose or confuse simulations."""


@pytest.mark.parametrize("trap", some(TRAPS, 1))
def test_nothing_is_lost_where_models_and_states_are_made_anew(tmp_path: Path, trap: str) -> None:
    text = f"{SCENE}{TRAPS[trap]}tell()\n"
    without_window = text.replace("mujoco.viewer.launch_passive(m, d)", "Open()")
    alone, run = bare(tmp_path / "bare", without_window), watched(tmp_path / "watched", text)
    assert alone.returncode == 0, alone.stderr
    assert run.printed == alone.stdout
    assert (run.received.faults, run.received.steps) == ([], 12)
    pieces = run.explained()
    told = Counter(
        statuse
        for world in {piece.world for piece in pieces}
        for statuse in statuses(pieces, world)
    )
    assert told == {(EXPLAINED, ""): 12}


def test_a_state_that_is_no_number_goes_on_as_it_is(tmp_path: Path) -> None:
    """With MuJoCo's automatic reset off, such steps are replayed, and have no sum."""
    text = f"""{SCENE}
m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
for k in range(8):
    if k == 4: d.qvel[6] = np.nan
    mujoco.mj_step(m, d)
    look()
tell()
"""
    alone, run = bare(tmp_path / "bare", text), watched(tmp_path / "watched", text)
    assert run.printed == alone.stdout
    assert "NaN" in run.printed
    assert statuses(run.explained()) == [(EXPLAINED, "")] * 4 + [(REPLAYED, "remainder")] * 4


def test_functions_are_counted_by_name(tmp_path: Path) -> None:
    run = watched(tmp_path, SCENE + WAYS["integrators"] + WAYS["two halves"])
    counts: Counter[str] = Counter()
    for piece in run.pieces:
        counts.update(STEPS[function] for function in piece.functions)
    assert counts == {"mj_Euler": 5, "mj_implicit": 5, "mj_RungeKutta": 5, "mj_step2": 20}


def test_what_was_written_without_a_call_is_found_between_its_lines(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
for k in range(10): mujoco.mj_step(m, d)  # A
d.qpos[2] = 1
d.xfrc_applied[1, 0] = 8
mujoco.mj_step(m, d)  # B
m.geom_friction[1, 0] = 0.2
m.opt.timestep = 0.001
d.ctrl[0] = -0.3
mujoco.mj_step(m, d)  # C
mujoco.mj_resetDataKeyframe(m, d, 0)  # D
d.qvel[6] = 2
mujoco.mj_forward(m, d)  # E
mujoco.mj_step(m, d)  # F
"""
    )
    run = watched(tmp_path, text)
    lines = {
        mark: 1 + [line.endswith(f"# {mark}") for line in text.splitlines()].index(True)
        for mark in "ABCDEF"
    }
    found = [
        (
            each.step,
            each.cause,
            run.line(each.since),
            run.line(each.site),
            each.argument,
            each.parts,
        )
        for each in run.written()[1:]
    ]
    teleport, ctrl, reset, spin = found
    assert teleport[:4] == (10, "memory", lines["A"], lines["B"])
    indices, values = teleport[5]["qpos"]
    assert (indices, values[2]) == (None, 1)
    assert teleport[5].keys() == {"qpos", "xfrc_applied"}
    assert ctrl[:4] == (11, "memory", lines["B"], lines["C"])
    assert ctrl[5].keys() == {"ctrl"}
    assert reset[:5] == (12, "mj_resetDataKeyframe", lines["C"], lines["D"], 0)
    assert reset[5]["qpos"][1].tolist() == [0, 0, 0.3, 1, 0, 0, 0, 0.5]
    assert reset[5]["ctrl"][1].tolist() == [0.5]
    assert spin[:4] == (12, "mj_forward", lines["D"], lines["E"])
    assert spin[5].keys() == {"qvel"}
    edits = [each for piece in run.pieces for each in piece.edited]
    assert sorted(
        (e.name, e.step, e.indices.tolist(), e.old.tolist(), e.new.tolist()) for e in edits
    ) == [
        ("geom_friction", 11, [3], [1.0], [0.2]),
        ("opt.timestep", 11, [0], [0.002], [0.001]),
    ]
    assert {(run.line(e.since), run.line(e.site)) for e in edits} == {(lines["B"], lines["C"])}
    assert statuses(run.explained()) == [(EXPLAINED, "")] * 13


def test_only_what_changed_is_sent(tmp_path: Path) -> None:
    """A long array that changes in few elements is sent as these elements."""
    bodies = "".join(
        f'<body pos="{i} 0 1"><freejoint/><geom size="0.1"/></body>' for i in range(40)
    )
    run = watched(
        tmp_path,
        f"""
import mujoco
m = mujoco.MjModel.from_xml_string('<mujoco><worldbody>{bodies}</worldbody></mujoco>')
d = mujoco.MjData(m)
for k in range(20):
    d.xfrc_applied[1 + k, 2] = k + 1
    mujoco.mj_step(m, d)
""",
    )
    _, *pushes = run.written()
    for step, push in enumerate(pushes, 1):
        indices, values = push.parts["xfrc_applied"]
        assert indices is not None
        assert (indices.tolist(), values.tolist()) == ([6 * (1 + step) + 2], [step + 1])


@pytest.mark.long
def test_addresses_that_are_used_again_are_other_simulations(tmp_path: Path) -> None:
    run = watched(
        tmp_path,
        SCENE
        + """
import gc
places = set()
for k in range(30):
    x = mujoco.MjData(m)
    x.qpos[2] = 1 + k
    mujoco.mj_step(m, x)
    places.add(id(x))
    del x
    gc.collect()
print(len(places))
for k in range(20):
    y = mujoco.MjModel.from_xml_string(XML.replace('kp="20"', f'kp="{k + 1}"'))
    z = mujoco.MjData(y)
    z.ctrl[0] = 1
    mujoco.mj_step(y, z)
    print(float(z.qvel[6]))
    del y, z
    gc.collect()
""",
    )
    used, *speeds = run.printed.splitlines()
    assert int(used) < 30  # else this shows nothing
    assert run.received.faults == []
    heights = [run.column("qpos", world)[0, 2] for world in range(30)]
    np.testing.assert_allclose(heights, np.arange(1, 31), atol=1e-3)
    assert [run.column("qvel", world)[0, 6] for world in range(30, 50)] == [*map(float, speeds)]
    pieces = run.explained()
    assert all(statuses(pieces, world) == [(EXPLAINED, "")] for world in range(50))


def test_threads_copies_and_models_are_simulations_of_their_own(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
import copy, threading
other = mujoco.MjModel.from_xml_string(XML.replace('kp="20"', 'kp="40"'))
for k in range(5): mujoco.mj_step(m, d)
e = copy.copy(d)
all_ = [d, e, mujoco.MjData(m), mujoco.MjData(m)]
def work(x, n):
    for k in range(n):
        x.ctrl[0] = 0.01 * k
        mujoco.mj_step(m, x)
threads = [threading.Thread(target=work, args=(x, 40 + n)) for n, x in enumerate(all_)]
for t in threads: t.start()
for t in threads: t.join()
for k in range(5): mujoco.mj_step(other, d)  # the same state with another model
for x in all_: look(x)
tell()
"""
    )
    alone, run = bare(tmp_path / "bare", text), watched(tmp_path / "watched", text)
    assert run.printed == alone.stdout
    counts = Counter({piece.world: 0 for piece in run.pieces})
    for piece in run.pieces:
        counts[piece.world] += len(piece.times_s)
    assert sorted(counts.values()) == sorted([5 + 40 + 5, 41, 42, 43])
    pieces = run.explained()
    made = [statuses(pieces, client) for client in range(5)]
    assert {each for its in made for each in its} == {(EXPLAINED, "")}
    assert sorted(map(len, made)) == sorted([5 + 40, 5, 41, 42, 43])
    models = [(piece.model, len(piece.times_s)) for piece in run.pieces if piece.world == 0]
    assert models == [(0, 45), (1, 5)]


def test_a_step_with_data_of_another_state_is_proven_to_be_one(tmp_path: Path) -> None:
    """dm_control runs the second half, then the first; its cheetah writes a pose in between."""
    run = watched(
        tmp_path,
        SCENE
        + """
mujoco.mj_step1(m, d)
for k in range(10):
    if k == 4: d.qpos[2] = 0.09  # written after step1: positions and contacts are of the old pose
    mujoco.mj_step2(m, d)
    mujoco.mj_step1(m, d)
mujoco.mj_step(m, d)
mujoco.mj_step2(m, d)  # with data of before the last step
""",
    )
    expected = [(EXPLAINED, "")] * 12
    expected[4] = expected[11] = (OTHER, "stale")
    assert statuses(run.explained()) == expected
    flags = np.concatenate([piece.flags for piece in run.pieces])
    assert flags.tolist() == [0] * 4 + [STALE] + [0] * 6 + [UNPOSED]


def test_a_reset_that_mujoco_makes_by_itself_is_seen(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
d.ctrl[0] = 0.4
for k in range(12):
    if k == 8: d.qvel[0] = 1e12
    mujoco.mj_step(m, d)
    look()
tell()
"""
    )
    alone, run = bare(tmp_path / "bare", text), watched(tmp_path / "watched", text)
    assert (run.printed, run.said) == (alone.stdout, alone.stderr)
    assert "Nan, Inf or huge value in QVEL" in run.printed + run.said  # older versions print it
    # MuJoCo alone logs it, in the folder where the script runs; nothing of ours does.
    assert (tmp_path / "bare/MUJOCO_LOG.TXT").exists()
    assert run.explained()
    assert [path.name for path in tmp_path.rglob("MUJOCO_LOG.TXT")] == ["MUJOCO_LOG.TXT"]
    assert not (tmp_path / "watched/MUJOCO_LOG.TXT").exists()
    (warning,) = [each for piece in run.pieces for each in piece.warnings]
    assert warning[0] == 8
    assert warning[2:] == (1, 0)
    times = np.concatenate([piece.times_s for piece in run.pieces])
    assert times[8] == times[0] < times[7]
    (reset,) = [each for each in run.written() if each.cause == "step"]
    assert reset.step == 9
    assert reset.parts["ctrl"][1].tolist() == [0]
    assert len(run.received.warnings) == 1


def test_every_reset_that_mujoco_makes_is_seen(tmp_path: Path) -> None:
    """A reset clears the warning counters, so the second reset leaves the same counts."""
    run = watched(
        tmp_path,
        SCENE
        + """
for k in range(30):
    if k in (8, 16, 17): d.qvel[0] = 1e12
    mujoco.mj_step(m, d)
""",
    )
    warnings = [warning for piece in run.pieces for warning in piece.warnings]
    assert [(step, times) for step, _, times, _ in warnings] == [(8, 1), (16, 1), (17, 1)]
    expected = [(EXPLAINED, "")] * 30
    for step in (8, 16, 17):
        expected[step] = (REPLAYED, "auto-reset")
    assert statuses(run.explained()) == expected


def test_a_scripts_own_handler_of_warnings_gets_them(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
mujoco.set_mju_user_warning(lambda text: print("heard", text))
d.qvel[0] = 1e12
mujoco.mj_step(m, d)
mujoco.set_mju_user_warning(None)
print(mujoco.get_mju_user_warning())
"""
    )
    alone, run = bare(tmp_path / "bare", text), watched(tmp_path / "watched", text)
    assert run.printed == alone.stdout
    assert run.printed.startswith("heard ")
    assert len(run.received.warnings) == 1


def test_errors_are_mujocos_own(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
import traceback
for arguments in ((m,), (m, d, 2.5), (d, m), (m, None), (), (m, d, 1, 2)):
    try:
        mujoco.mj_step(*arguments)
    except TypeError:
        print(traceback.format_exc())
def fails(m, d):
    raise ValueError
mujoco.set_mjcb_control(fails)
for call in (
    lambda: mujoco.mj_step(m, d), lambda: mujoco.mj_forward(m, d), lambda: mujoco.mj_forward(3),
    lambda: mujoco.mj_resetData(m, 3), lambda: mujoco.set_mjcb_control(3),
):
    try:
        call()
    except Exception:
        print(traceback.format_exc())
mujoco.mj_step(m, d, nstep=3, steps=3)
"""
    )
    alone, run = bare(tmp_path / "bare", text, alone=True), watched(tmp_path / "watched", text)
    assert run.printed.count("Traceback") == 11
    assert alone.returncode == 1
    plain = re.compile(r"object at 0x\w+|mj_step\(\)")
    for mine, theirs in ((run.printed, alone.stdout), (run.said, alone.stderr)):
        assert plain.sub("", mine) == plain.sub("", theirs).replace(
            str(tmp_path / "bare"), str(tmp_path / "watched")
        )


def test_a_viewer_needs_no_window_and_ends_with_the_steps(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
import mujoco.viewer, time
with mujoco.viewer.launch_passive(m, d, key_callback=print, show_left_ui=False) as viewer:
    viewer.cam.distance = 3
    viewer.opt.flags[0] = 1
    with viewer.lock():
        viewer.user_scn.ngeom = 0
    while viewer.is_running():
        began = time.time()
        mujoco.mj_step(m, d)
        viewer.sync()
        viewer.set_texts((None, None, "a", "b"))
        left = m.opt.timestep - (time.time() - began)
        if left > 0: time.sleep(left)
"""
    )
    run = watched(tmp_path, text, steps=25)
    assert (run.ending.how, run.ending.error) == ("steps", "")
    assert run.steps() == 25
    assert run.received.viewer


def test_a_script_that_waits_for_a_viewers_user_ends(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
from mujoco import viewer
mujoco.mj_step(m, d)
window = viewer.launch_passive(m, d)
while window.is_running():
    window.sync()
"""
    )
    run = watched(tmp_path, text)
    assert (run.ending.how, run.steps()) == ("idle", 1)


def test_what_cannot_be_caught_is_named(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
from mujoco import rollout
state = np.zeros(mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_FULLPHYSICS))
mujoco.mj_getState(m, d, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
for k in range(2):
    rollout.rollout(m, d, state, nstep=3)  # R
if mujoco.__version__ >= "4":
    from mujoco import batch
    many = batch.Batch(m, nsim=2, nthread=1)
    many.step()  # S
for k in range(5):
    d.qpos[:3] += 0.001
    d.time += 0.01
    mujoco.mj_forward(m, d)
"""
    )
    run = watched(tmp_path, text)
    assert run.ending.how == "finished", run.said
    names = [(each["name"], text.splitlines()[each["line"] - 1]) for each in run.received.uncaught]
    expected = [("mujoco.rollout.rollout", "    rollout.rollout(m, d, state, nstep=3)  # R")]
    if run.received.version >= "4":
        expected.append(("mujoco.batch.Batch.step", "    many.step()  # S"))
    assert names == expected
    assert run.received.steps == 0
    assert run.received.posed_without_steps == {0: 4}


def test_nothing_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
import os, signal
for k in range(777): mujoco.mj_step(m, d)
os.kill(os.getpid(), signal.SIGKILL)
"""
    )
    run = watched(tmp_path, text)
    assert run.ending.how == "failed"
    assert run.steps() == 777
    assert statuses(run.explained()) == [(EXPLAINED, "")] * 777


def test_a_library_that_steps_is_named_beside_the_scripts_line(tmp_path: Path) -> None:
    library = tmp_path / "site-packages/simulator"
    library.mkdir(parents=True)
    library.joinpath("__init__.py").write_text(
        "import mujoco\ndef advance(m, d):\n    mujoco.mj_step(m, d)\n"
    )
    text = SCENE + (
        "import sys\nsys.path.insert(0, 'site-packages')\nimport simulator\n"
        "for k in range(3): simulator.advance(m, d)  # here\n"
    )
    run = watched(tmp_path, text)
    (site,) = {int(each) for piece in run.pieces for each in piece.sites}
    found = run.received.sites[site]
    here = 1 + [line.endswith("# here") for line in text.splitlines()].index(True)
    assert (found.file, found.line, found.via_line) == ("script.py", here, 3)
    assert found.via.endswith("simulator/__init__.py")


def test_a_forked_child_is_not_recorded(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
import os
mujoco.mj_step(m, d)
if os.fork() == 0:
    for k in range(5): mujoco.mj_step(m, d)
    os._exit(0)
os.wait()
mujoco.mj_step(m, d)
"""
    )
    run = watched(tmp_path, text)
    assert (run.ending.how, run.steps()) == ("finished", 2)
    assert run.ending.notes == [ELSEWHERE]


BLOCK = """
import os, tempfile
from drop_physics.engines.watching import ending, start
from drop_physics.engines.watching.pipe import SHARED_BYTES
plain = mujoco.mj_step
with tempfile.TemporaryFile() as block:
    block.truncate(SHARED_BYTES)
    stream = os.open("stream", os.O_WRONLY | os.O_CREAT)
    watch = start.watch(stream, os.dup(block.fileno()), steps=None, duration_s=None,
        keep_sleeping=False, seed=None)
    for k in range(4): mujoco.mj_step(m, d)
    kept = mujoco.mj_step
    ending.end(watch, "finished")
    watch.remove()
    watch.pipe.close()
print(mujoco.mj_step is plain, mujoco.get_mju_user_warning())
kept(m, d)
print(round(d.time / m.opt.timestep))
"""


def test_a_block_puts_everything_back(tmp_path: Path) -> None:
    done = bare(tmp_path, SCENE + BLOCK)
    assert done.stdout.splitlines() == ["True None", "5"], done.stderr
    stream = (tmp_path / "stream").read_bytes()
    assert stream.count(b'"what": "world"') == 1


def test_numbers_of_what_is_sent_are_small(tmp_path: Path) -> None:
    """A step takes the bytes that it changes, and a header of 29."""
    run = watched(tmp_path, SCENE + "for k in range(1000): mujoco.mj_step(m, d)\n")
    numbers = run.column("qpos").shape[1] + 2 * run.column("qvel").shape[1]
    steps = sum(len(each) for each in run.sent if each[:1] == b"S")
    assert steps <= 1000 * (8 * numbers + 24 + 3 * 64)


def test_a_model_is_sent_once(tmp_path: Path) -> None:
    """An environment that is created again has the same model, recognized by its digest."""
    run = watched(
        tmp_path,
        SCENE
        + """
for k in range(5):
    m = mujoco.MjModel.from_xml_string(XML)
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d)
""",
    )
    models: list[Any] = [*run.received.models.values()]
    assert len(models) == 5
    assert len({model.digest for model in models}) == 1
    assert all(
        model.arrays["body_mass"].tolist() == models[0].arrays["body_mass"].tolist()
        for model in models
    )
    assert b"".join(run.sent).count(b'"what": "binary"') == 1
    assert "tex_data" not in models[0].arrays
    pieces = run.explained()
    assert all(statuses(pieces, world) == [(EXPLAINED, "")] for world in range(5))


def test_what_cannot_be_read_is_said_once_and_the_script_goes_on(tmp_path: Path) -> None:
    """States are read from memory: if the layout is not as expected, nothing is recorded."""
    text = (
        SCENE
        + """
import sys
for name, module in list(sys.modules.items()):
    if name.endswith("mujoco.memory"):
        module.ALIGNED = -1  # no two arrays lie so close
for k in range(5):
    mujoco.mj_step(m, d)
    look()
tell()
"""
    )
    alone, run = bare(tmp_path / "bare", text), watched(tmp_path / "watched", text)
    assert (run.printed, run.ending.how) == (alone.stdout, "finished")
    assert run.received.steps == 0
    (fault,) = run.received.faults
    assert "does not lie behind" in fault


def test_states_that_a_script_has_let_go_of_are_forgotten(tmp_path: Path) -> None:
    text = (
        SCENE
        + """
import gc
for k in range(200):
    mujoco.mj_step(m, mujoco.MjData(m))
(watch,) = [x for x in gc.get_objects() if type(x).__name__ == "MujocoWatch"]
print(len(watch.data) < 70)
"""
    )
    run = watched(tmp_path, text)
    assert run.printed == "True\n"
    assert len({piece.world for piece in run.pieces}) == 200


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_the_arena_of_a_state_takes_no_memory(tmp_path: Path) -> None:
    """300 boxes have an arena of 200 MB, of which MuJoCo uses about 2 MB."""
    text = """
import mujoco
def peak_kb():
    with open("/proc/self/status") as file:
        return int(file.read().partition("VmHWM:")[2].split()[0])
body = '<body pos="%d 0 1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
bodies = "".join(body % i for i in range(300))
before = peak_kb()
m = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
d = mujoco.MjData(m)
mujoco.mj_step(m, d)
print(m.narena > 150e6, peak_kb() - before < 60_000)
try:
    mujoco.MjData(1)
except TypeError as error:
    print(error.__traceback__.tb_next)
"""
    assert watched(tmp_path, text).printed == "True True\nNone\n"


def test_what_a_state_leaves_is_not_filled(tmp_path: Path) -> None:
    """A state of one body has an arena of 14 MB; a second state reuses the first one's memory."""
    text = """
import mujoco
def peak_kb():
    with open("/proc/self/status") as file:
        return int(file.read().partition("VmHWM:")[2].split()[0])
m = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
before = peak_kb()
for _ in range(5):
    mujoco.MjData(m)
print(m.narena > 13e6, peak_kb() - before < 5_000)
"""
    assert watched(tmp_path, text).printed == "True True\n"

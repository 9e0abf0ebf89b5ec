"""The causal search's single changes, computed in a script's own process.

A script that is seen says there what could be changed; a run with one of these changes is what the
script would be if its user had written that.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drop_physics.engines.cures import TABLES
from drop_physics.engines.mujoco.watch import single_changes as of_mujoco
from drop_physics.engines.pybullet.watch import single_changes as of_bullet
from drop_physics.engines.watching.single_changes import Change
from drop_physics.trace.events import Samples
from watching import watched

SEES = """
import dataclasses, json, os, runpy, tempfile
from drop_physics.engines.watching import ending, start
from drop_physics.engines.watching.pipe import SHARED_BYTES
tables = json.load(open("tables.json"))
with tempfile.TemporaryFile() as block:
    block.truncate(SHARED_BYTES)
    watch = start.watch(os.open("pipe", os.O_WRONLY | os.O_CREAT), os.dup(block.fileno()),
        steps=None, duration_s=None, keep_sleeping=False, seed=None, interventions=tables["sees"])
    runpy.run_path("script.py", run_name="__main__")
    found = [each for engine in watch.engines for each in engine.possible(tables["tried"])]
    json.dump([dataclasses.asdict(each) for each in found], open("found.json", "w"))
    ending.end(watch, "finished")
    watch.remove()
"""
BULLET = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for step in range(30):
    for joint in range(7):
        p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, 0.4, force={force})
    p.stepSimulation()
"""
MUJOCO = """
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" friction="{friction}"/>
</body></worldbody></mujoco>''')
def main():
    d = mujoco.MjData(m)
    d.qvel[0] = 1
    for step in range(60):
        mujoco.mj_step(m, d)
main()
"""


def changes(folder: Path, text: str, engine: str) -> list[Change]:
    """Return the changes to a script, as found in its own process."""
    table = TABLES[engine]
    folder.joinpath("tables.json").write_text(
        json.dumps({"sees": table.sees, "tried": table.tried})
    )
    folder.joinpath("script.py").write_text(text)
    folder.joinpath("sees.py").write_text(SEES)
    subprocess.run([sys.executable, "sees.py"], cwd=folder, check=True)
    return [Change(**load) for load in json.loads(folder.joinpath("found.json").read_text())]


def states(folder: Path, text: str, **how: Any) -> bytes:
    """Return all positions in a run of a script."""
    events, ending, _ = watched(folder, text, **how)
    assert ending.how == "finished", ending.error
    parts = [event for event in events if isinstance(event, Samples)]
    return b"".join(
        np.asarray(each, float).tobytes()
        for part in parts
        for each in (*part.bases.values(), *(one.position for one in part.joints.values()))
    )


@pytest.mark.pybullet
def test_a_change_of_a_pybullet_script_is_found_and_made_in_its_process(tmp_path: Path) -> None:
    text = BULLET.format(force=40)
    (found,) = (
        change
        for change in changes(tmp_path, text, "PyBullet")
        if (change.change, change.op) == ("setJointMotorControl2.force", "*0.1")
    )
    assert found.of[-1] == "lbr_iiwa_joint_7 of lbr_iiwa"
    assert found.site == ["script.py", 9]
    trial = of_bullet.trial_of(found)
    made = states(tmp_path, text, interventions=trial["interventions"])
    assert made == states(tmp_path, BULLET.format(force=4))
    assert made != states(tmp_path, text)


def test_a_change_of_a_mujoco_script_is_found_and_made_in_its_process(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = MUJOCO.format(friction=0.5)
    (found,) = (
        change
        for change in changes(tmp_path, text, "MuJoCo")
        if (change.change, change.op) == ("geom_friction", "*10")
    )
    assert found.of == ["world", "box"]
    trial = of_mujoco.trial_of(found.of_some([1]).by(5))
    made = states(tmp_path, text, interventions=trial["interventions"])
    assert made == states(tmp_path, MUJOCO.format(friction="2.5 0.025 0.0005"))
    assert made != states(tmp_path, text)

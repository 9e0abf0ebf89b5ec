"""MuJoCo scripts in an interpreter whose MuJoCo version differs from ours.

`.ci/run` makes one with the oldest that is supported, and names it in `OLDER_MUJOCO`.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script

OLDER = os.environ.get("OLDER_MUJOCO", "")
SCRIPTS = Path(__file__).parent / "corpus/mujoco/scripts"

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not OLDER, reason="OLDER_MUJOCO names no interpreter with mujoco 3.3"),
]


@pytest.mark.parametrize(
    "name", ["weak_forcerange", "grasp_creeps", "push_stays", "reset_keeps_ctrl", "right_stack"]
)
def test_a_script_of_an_older_mujoco_prints_the_same_and_is_explained(
    name: str, tmp_path: Path
) -> None:
    script, printed = SCRIPTS / f"{name}.py", tmp_path / "printed.txt"
    bare = subprocess.run([OLDER, script], cwd=tmp_path, capture_output=True, check=True)
    with printed.open("wb") as stdout:
        recorded = record_script(
            str(script), out=tmp_path / "run.rrd", python=OLDER, stdout=stdout.fileno()
        )
    assert recorded.ended == "finished"
    assert printed.read_bytes() == bare.stdout
    analysis = analyze(recorded.recording)
    assert analysis.explained.samples == analysis.explained.of > 0
    assert analysis.explained.remainder <= 1e-12

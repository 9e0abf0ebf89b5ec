"""Eight scripts from PyBullet's wheel: recorded twice, and run without reading the engine.

`public_scripts` does the same with all of them, and with those that are found elsewhere.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from drop_physics.recording.viewer import binary
from drop_physics.stages.record import record_script
from witness import interpreter

pytestmark = pytest.mark.long

EXAMPLES = (
    "biped2d_pybullet", "constraint", "deformable_anchor", "mimicJointConstraint", "sleeptest",
    "snake", "soccerball", "video_sync_mp4",
)  # fmt: skip


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_public_script_ends_the_same_read_and_unread_and_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    python, null = str(interpreter(tmp_path)), os.open(os.devnull, os.O_WRONLY)
    ends = []
    for blind in ("1", "0"):
        told = tmp_path / f"ends-{blind}"
        monkeypatch.setenv("WITNESS", str(told))
        monkeypatch.setenv("WITNESS_BLIND", blind)
        recorded = record_script(
            f"pybullet_examples.{name}",
            is_module=True,
            out="out.rrd",
            steps=40,
            seed=0,
            twice=blind == "0",
            python=python,
            force=True,
            stdout=null,
        )
        assert recorded.ended == "steps", recorded.error
        ends.append(told.read_text())
    os.close(null)
    assert recorded.samples == 41
    assert recorded.first_difference is None
    unread, read = ends
    assert "\n40 " in f"\n{unread}"
    assert read == 2 * unread
    verified = subprocess.run(
        [binary(), "rrd", "verify", "out.rrd"], capture_output=True, text=True, check=False
    )
    assert verified.returncode == 0, verified.stderr

"""Prevents MuJoCo in drop's own process from writing a log file."""

from __future__ import annotations

import mujoco


def write_no_log() -> None:
    """Keep MuJoCo from appending its warnings to MUJOCO_LOG.TXT in the working directory."""
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(lambda _: None)

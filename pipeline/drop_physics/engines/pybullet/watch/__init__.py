"""Watches a PyBullet script from within its own interpreter, and sends calls and steps.

It needs Python 3.9 or later, the standard library, and the script's own pybullet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...watching.host import ScriptWatch
from .hooks import BulletWatch
from .varied import varied_by


def begin(
    host: ScriptWatch, operations: Sequence[Mapping[str, Any]], variation: dict[str, Any] | None
) -> None:
    """Start watching PyBullet as soon as the script imports it."""
    watch = BulletWatch(host, variation=varied_by(variation), interventions=operations)
    host.on_extension("pybullet", watch.install)

"""The part of `drop record` that runs in a PyBullet script's own interpreter: calls and steps.

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
    """Watch PyBullet as soon as it is imported; a script may unload it, and import it again."""
    watch = BulletWatch(host, variation=varied_by(variation), interventions=operations)
    host.on_extension("pybullet", watch.install)

"""Lookup of an engine's table of interventions, which words cures and makes runs with them."""

from __future__ import annotations

from collections.abc import Callable

from drop_physics.engines.interventions import FACTOR, ChangeRow, Interventions
from drop_physics.engines.mujoco.interventions import INTERVENTIONS as MUJOCO
from drop_physics.engines.pybullet.interventions import INTERVENTIONS as BULLET
from drop_physics.trace.cures import Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

TABLES = {PYBULLET: BULLET, "MuJoCo": MUJOCO}
"""The interventions of each engine, by the engine's name."""
ROWS: dict[str, ChangeRow] = {
    name: row for table in TABLES.values() for name, row in table.rows.items() if ":" not in name
}
"""The rows of all engines by their names, as `--try` and `--vary` take them."""
FACTORS = {
    key.partition(":")[0]
    for table in TABLES.values()
    for key in table.rows
    if key.endswith(f":{FACTOR}")
}
"""The names of rows whose number is a factor, or a size, if they are made on the whole run."""
PARAMETERS = BULLET.parameters | MUJOCO.parameters
"""What `parameter` sets, of all engines."""


def cures_of(engine: str) -> Interventions:
    """Return the cures of the engine of a recording."""
    return TABLES[engine.partition(" ")[0]]


def call_of(engine: str) -> Callable[[Cure], str]:
    """Return the function that words a cure as a user of an engine would."""
    cures = TABLES.get(engine.partition(" ")[0])
    return (lambda cure: cure.call) if cures is None else cures.call_of  # of a drop elsewhere

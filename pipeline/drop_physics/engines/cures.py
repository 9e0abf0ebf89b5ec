"""Lookup of an engine's table of interventions, which words cures and makes runs with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from drop_physics.engines import source
from drop_physics.engines.interventions import FACTOR, ChangeRow, Interventions
from drop_physics.engines.mujoco.interventions import INTERVENTIONS as MUJOCO
from drop_physics.engines.pybullet.interventions import INTERVENTIONS as BULLET
from drop_physics.trace.cures import Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

if TYPE_CHECKING:
    from drop_physics.engines.watching.single_changes import Change

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
RUN = "run"
"""The operator of a change that is an intervention, whose operand is the fields of its program."""
PARAMETERS = BULLET.parameters | MUJOCO.parameters
"""Parameters that `parameter` sets, for all engines."""


def cures_of(engine: str) -> Interventions:
    """Return the cures of the engine of a recording."""
    return TABLES[engine.partition(" ")[0]]


def trial_of(change: Change) -> dict[str, Any]:
    """Return the differences of a run with a single change, by the fields of its program."""
    if change.how[0] == RUN:
        return {**change.how[1]}
    if change.engine == source.SOURCE:
        return {"edits": source.edits_of(change)}
    return TABLES[change.engine].trial_of(change)


def words_of(change: Change) -> str:
    """Return a single change in words, as its user would say it: friction of left, right ×10."""
    if change.how[0] == RUN:
        return change.change
    if change.engine == source.SOURCE:
        return source.words_of(change)
    return TABLES[change.engine].words_of(change)


def written_as(change: Change) -> tuple[str, str] | None:
    """Return the attribute that a change is of, and a pattern of the tags that have it.

    None of a change that is of none.
    """
    table = TABLES.get(change.engine)
    return None if table is None else table.written_as(change)


def call_of(engine: str) -> Callable[[Cure], str]:
    """Return the function that words a cure as a user of an engine would."""
    cures = TABLES.get(engine.partition(" ")[0])
    return (lambda cure: cure.call) if cures is None else cures.call_of  # of a drop elsewhere

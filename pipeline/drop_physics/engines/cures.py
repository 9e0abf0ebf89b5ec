"""Finds an engine's table of changes, which defines how each change is written and tried."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drop_physics.engines import source
from drop_physics.engines.interventions import FACTOR, ChangeRow, Interventions
from drop_physics.engines.mujoco.interventions import INTERVENTIONS as MUJOCO
from drop_physics.engines.pybullet.interventions import INTERVENTIONS as BULLET
from drop_physics.engines.watching.single_changes import Change
from drop_physics.trace.cures import ChangedRun, Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

TABLES = {PYBULLET: BULLET, "MuJoCo": MUJOCO}
"""Module of each engine's table of interventions, by the engine's name."""
ROWS: dict[str, ChangeRow] = {
    name: row for table in TABLES.values() for name, row in table.rows.items() if ":" not in name
}
"""The rows of all engines, by the name that `--try` and `--vary` accept."""
FACTORS = {
    key.partition(":")[0]
    for table in TABLES.values()
    for key in table.rows
    if key.endswith(f":{FACTOR}")
}
"""Names of rows whose number is a factor or a magnitude if the change applies to the whole run."""
RUN = "run"
"""The operator of a change that is an intervention; its operand is an `IntervenedRun`."""
PARAMETERS = BULLET.parameters | MUJOCO.parameters
"""Engine parameters that `parameter` sets, for all engines."""


def cures_of(engine: str) -> Interventions:
    """Return the table of changes for a recording's engine."""
    return TABLES[engine.partition(" ")[0]]


@dataclass(frozen=True)
class IntervenedRun:
    """The run that an intervention makes, and how a user would write the intervention."""

    run: ChangedRun
    call: str


def intervened(name: str, value: float | None, call: str, run: ChangedRun) -> Change:
    """Return an intervention as a change, named as `--try` takes it."""
    named = name if value is None else f"{name}={value:g}"
    return Change(named, "", (RUN, IntervenedRun(run, call)))


def trial_of(change: Change) -> ChangedRun:
    """Return the run with a single change."""
    if change.how[0] == RUN:
        intervention: IntervenedRun = change.how[1]
        return intervention.run
    if change.engine == source.SOURCE:
        return ChangedRun(edits=source.edits_of(change), longer=source.repeats(change))
    made = TABLES[change.engine].trial_of(change)
    return ChangedRun(made["interventions"], made["variation"])


def words_of(change: Change) -> str:
    """Describe a single change as a user would write it, e.g. friction of left, right ×10."""
    if change.how[0] == RUN:
        intervention: IntervenedRun = change.how[1]
        return intervention.call
    if change.engine == source.SOURCE:
        return source.words_of(change)
    return TABLES[change.engine].words_of(change)


def written_as(change: Change) -> tuple[str, str] | None:
    """Return the XML attribute that a change edits, and a pattern of the tags that have it.

    None if the change does not edit an XML attribute.
    """
    table = TABLES.get(change.engine)
    return None if table is None else table.written_as(change)


def follows(change: Change) -> str:
    """Return the call that must follow a change made between two steps; empty if none is needed."""
    table = TABLES.get(change.engine)
    return "" if table is None else table.follows(change)


def call_of(engine: str) -> Callable[[Cure], str]:
    """Return a function that writes suggested changes as code for an engine."""
    cures = TABLES.get(engine.partition(" ")[0])
    return (lambda cure: cure.call) if cures is None else cures.call_of  # of a drop elsewhere

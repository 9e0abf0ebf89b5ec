"""Matches the simulations and bodies of two recordings.

Ids cannot be used for this: client ids are shifted by any earlier connection, even an unused one,
and bodies are numbered in the order of their appearance, which depends on how threads take turns.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.states import Rows


@dataclass(frozen=True)
class Pairing:
    """The corresponding simulations and bodies of the checked and the golden recording."""

    clients: Mapping[int, int]
    """Simulation ids in the checked recording, by golden id; simulations that only the golden
    recording has are given unused ids."""
    bodies: Mapping[int, Body]
    """The golden recording's bodies, by their id in the checked recording; by an unused id if that
    lacks the body."""
    common: Mapping[int, Body]
    """The checked recording's bodies that both recordings have, by id."""

    @cached_property
    def numbers(self) -> dict[int, int]:
        """Ids in the checked recording, by the golden recording's body ids."""
        return {body.number: number for number, body in self.bodies.items()}

    def label(self, number: int) -> str:
        """Return the label of a golden body, by its id in the checked recording."""
        return (self.common.get(number) or self.bodies[number]).label

    def renumbered(self, rows: Rows, *fields: str) -> Rows:
        """Replace body ids in rows of the golden recording by those of the checked one."""
        if all(old == new for old, new in self.numbers.items()):
            return rows
        renumbered = rows.copy()
        for name in fields:
            for old, new in self.numbers.items():
                renumbered[name][rows[name] == old] = new
        return renumbered


def pairing(run: Seen, golden: Seen) -> Pairing:
    """Match the simulations and bodies of two recordings.

    Simulations are matched in the order of their connections, ignoring unused ones; within two
    matched simulations, bodies of the same name are matched in the order of their appearance.
    """
    clients = _clients(run, golden)
    mine = _named(run, {client: client for client in _used(run)})
    theirs = _named(golden, clients)
    unused = max((*run.bodies, *golden.bodies), default=-1) + 1
    bodies, common = {}, {}
    for key, body in theirs.items():
        if key in mine:
            number = mine[key].number
            common[number] = mine[key]
        elif body.number in run.bodies:
            number, unused = unused, unused + 1
        else:
            number = body.number
        bodies[number] = body
    return Pairing(clients, bodies, {number: common[number] for number in sorted(common)})


def lengths(run: Seen, golden: Seen, pairs: Pairing) -> dict[int, tuple[int, int]]:
    """Return the sample counts of simulations, by id, where the two recordings differ."""
    counts = {
        mine: (run.samples[mine], golden.samples[theirs])
        for theirs, mine in pairs.clients.items()
        if mine in run.samples and theirs in golden.samples
    }
    return {client: both for client, both in counts.items() if both[0] != both[1]}


def _used(seen: Seen) -> set[int]:
    """Return the simulations that have bodies; in others, settings have no effect."""
    with_bodies = {body.client for body in seen.bodies.values()}
    return with_bodies or {each.client for each in seen.settings}


def _named(seen: Seen, clients: Mapping[int, int]) -> dict[tuple[int, str, int], Body]:
    """Return bodies by simulation, name, and the number of earlier bodies with that name."""
    before: Counter[tuple[int, str]] = Counter()
    named = {}
    for _, body in sorted(seen.bodies.items()):
        key = clients[body.client], body.short
        named[*key, before[key]] = body
        before[key] += 1
    return named


def _clients(run: Seen, golden: Seen) -> dict[int, int]:
    """Map the golden recording's simulation ids to the checked recording's."""
    mine, theirs = sorted(_used(run)), sorted(_used(golden))
    unused = itertools.count(max(mine, default=-1) + 1)
    return dict(zip(theirs, itertools.chain(mine, unused), strict=False))

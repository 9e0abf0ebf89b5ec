"""Replays the recorded motor commands of one run in a repeated run."""

from __future__ import annotations

from typing import Any

from drop_physics.engines.interventions import Operation
from drop_physics.engines.pybullet.watch.functions import COMMANDS, ROLES
from drop_physics.trace.history import Seen


def played(seen: Seen, client: int, first: int, last: int) -> list[Operation]:
    """Return the operation that feeds recorded motor commands to the steps between two samples.

    The list is empty if no motor commands were recorded.
    """
    piece = seen.sampled.piece(first, last + 1)
    found: list[tuple[int, tuple[int, int, int, dict[str, Any]]]] = []
    for command in piece.calls.commands():
        if command.client != client:
            continue
        rows = zip(command.calls, command.steps, command.bodies, command.joints, strict=True)
        for k, (call, *where) in enumerate(rows):
            step, body, joint = map(int, where)
            values = {name: each[k].tolist() for name, each in command.values.items()}
            if step > first:  # the commands of the first step were given before the runs part
                found.append((int(call), (step, body, joint, values)))
    commands = [each for _, each in sorted(found, key=lambda each: each[0])]
    functions = [*sorted(COMMANDS), ROLES["steps"]]
    ends = {"first": first, "last": last}
    operation = {"do": "play", "functions": functions, "commands": commands, **ends}
    return [operation] if commands else []

"""Serves requests to repeat recorded calls, and replies with the states after each step.

A request is a line of JSON: the calls and the number of steps. A call has its function, its
arguments by name, the object that it creates, and the number of steps before it. `["body", 3]` in
an argument stands for the id returned by the call that created body 3. An answer is a line of JSON,
followed by as many numbers as the line says.
"""

from __future__ import annotations

import json
import os
import sys
from array import array
from typing import Any

import pybullet as p

from ..watch.arguments import ARGUMENTS


def main() -> None:
    """Serve requests until the input ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what PyBullet prints must not get into the answer
    for line in sys.stdin.buffer:
        request = json.loads(line)
        rows: list[list[Any]] = []
        numbers, error = array("d"), ""
        try:
            _play(request["calls"], request["steps"], request["folders"], rows, numbers)
        except Exception as failed:  # noqa: BLE001 - whatever a call of another log raises
            error = f"{type(failed).__name__}: {failed}"
        answer = {"rows": rows, "count": len(numbers), "error": error}
        out.write(json.dumps(answer).encode() + b"\n" + numbers.tobytes())
        out.flush()


def _play(
    calls: list[list[Any]],
    steps: int,
    folders: list[str],
    rows: list[list[Any]],
    numbers: array[float],
) -> None:
    """Repeat calls and steps in a separate simulation; append the states after each step."""
    client = p.connect(p.DIRECT)
    try:
        for folder in folders:
            p.setAdditionalSearchPath(folder, physicsClientId=client)
        made: dict[tuple[Any, ...], int] = {}
        at = 0
        for step in range(steps):
            while at < len(calls) and calls[at][0] <= step:
                _call(client, calls[at], made)
                at += 1
            p.stepSimulation(physicsClientId=client)
            rows.append(_state(client, made, numbers))
    finally:
        p.disconnect(physicsClientId=client)


def _call(client: int, call: list[Any], made: dict[tuple[Any, ...], int]) -> None:
    _, function, given, makes, raises = call
    arguments = {name: _filled(value, made) for name, value in given.items()}
    if "physicsClientId" in ARGUMENTS.get(function, ()):
        arguments["physicsClientId"] = client
    try:
        result = getattr(p, function)(**arguments)
    except p.error:
        if raises:  # as it did in the script
            return
        raise
    if makes is not None:
        made[tuple(makes)] = result


def _filled(value: Any, made: dict[tuple[Any, ...], int]) -> Any:  # noqa: ANN401
    """Return an argument with ids from the log replaced by those of the created objects."""
    if isinstance(value, list):
        if len(value) == 2 and isinstance(value[0], str) and tuple(value) in made:
            return made[tuple(value)]
        return [_filled(each, made) for each in value]
    return value


def _state(client: int, made: dict[tuple[Any, ...], int], numbers: array[float]) -> list[Any]:
    """Append the states of all bodies; return their ids, and how many numbers each one has."""
    there = {
        p.getBodyUniqueId(n, physicsClientId=client)
        for n in range(p.getNumBodies(physicsClientId=client))
    }
    row = []
    for name, body in made.items():
        if name[0] != "body" or body not in there:
            continue
        before = len(numbers)
        position, orientation = p.getBasePositionAndOrientation(body, physicsClientId=client)
        rates = p.getBaseVelocity(body, physicsClientId=client)
        for part in (position, orientation, *rates):
            numbers.extend(part)
        joints = range(p.getNumJoints(body, physicsClientId=client))
        for joint in joints:
            state = p.getJointState(body, joint, physicsClientId=client)
            numbers.extend(state[:2])
        row.append([name[1], len(numbers) - before])
    return row

"""A recording with the numbers that another gives the same simulations and bodies.

Numbers say nothing of what is simulated: another connection before, even an unused one, shifts
those of clients; and bodies are numbered as they come, which depends on how threads take turns
where each steps a simulation of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import polars as pl

from pipeline.seen import Body, Seen


def aligned(golden: Seen, run: Seen) -> Seen:
    """Return the golden recording with the numbers of the checked one.

    Clients correspond that make the same calls, else that have the same bodies, else that share a
    body, else in the order of their numbers. Bodies of two such clients correspond that came as the
    same and have the same name. Those that only golden has get numbers that the other does not use.
    """
    clients = _clients_of(golden, run)
    bodies = _bodies_of(golden, run, clients)
    if all(old == new for old, new in clients.items()) and bodies == golden.bodies:
        return golden
    numbers = {old: body.number for old, body in bodies.items()}

    def of(event: Any) -> Any:  # noqa: ANN401 - any event of a body
        new = bodies[event.body.number]
        names = {"number": new.number, "label": new.label, "client": new.client}
        return replace(event, body=replace(event.body, **names))

    def of_client(event: Any, **more: object) -> Any:  # noqa: ANN401 - any event of a client
        return replace(event, client=clients[event.client], **more)

    def renumbered(table: pl.DataFrame, *columns: str) -> pl.DataFrame:
        return table.with_columns(pl.col(columns).replace(numbers))

    return replace(
        golden,
        bodies={body.number: body for body in bodies.values()},
        appearances=[of(each) for each in golden.appearances],
        dynamics=[of(each) for each in golden.dynamics],
        given=[of(each) for each in golden.given],
        pushes=[of(each) for each in golden.pushes],
        motors=[of(each) for each in golden.motors],
        puts=[of(each) for each in golden.puts],
        settings=[of_client(each) for each in golden.settings],
        solvers=[of_client(each) for each in golden.solvers],
        calls=[of_client(each) for each in golden.calls],
        constraints=[
            of_client(each, bodies=tuple(numbers[number] for number in each.bodies))
            for each in golden.constraints
        ],
        samples={clients.get(client, client): n for client, n in golden.samples.items()},
        states=renumbered(golden.states, "body").sort("body", "link", "step"),
        contacts=renumbered(golden.contacts, "body_a", "body_b"),
        joints={numbers[number]: joints for number, joints in golden.joints.items()},
    )


def _clients_of(golden: Seen, run: Seen) -> dict[int, int]:
    """Return the number in the checked recording of each client of the golden one."""
    mine, theirs = _facts(run), _facts(golden)
    pairs: dict[int, int] = {}
    for alike in (_same_calls, _same_bodies, _share_a_body, _exist):
        for client in sorted(theirs.keys() - pairs.keys()):
            free = sorted(mine.keys() - pairs.values())
            same = (each for each in free if alike(mine[each], theirs[client]))
            if (found := next(same, None)) is not None:
                pairs[client] = found
    unused = max(mine, default=-1) + 1
    rest = sorted(theirs.keys() - pairs.keys())
    return pairs | {client: unused + number for number, client in enumerate(rest)}


class _Facts(NamedTuple):
    """What is known of a client."""

    calls: list[tuple[str, str]]
    """Functions and arguments, in order."""
    bodies: list[str]
    """Names, in order."""


def _facts(seen: Seen) -> dict[int, _Facts]:
    clients = {body.client for body in seen.bodies.values()}
    clients |= {each.client for each in seen.settings} | {each.client for each in seen.constraints}
    clients |= {each.client for each in seen.calls}
    facts = {client: _Facts([], []) for client in clients}
    for call in seen.calls:
        facts[call.client].calls.append((call.function, call.arguments))
    for _, body in sorted(seen.bodies.items()):
        facts[body.client].bodies.append(_name(body))
    return facts


def _same_calls(one: _Facts, other: _Facts) -> bool:
    return one == other


def _same_bodies(one: _Facts, other: _Facts) -> bool:
    return one.bodies == other.bodies


def _share_a_body(one: _Facts, other: _Facts) -> bool:
    return bool({*one.bodies} & {*other.bodies})


def _exist(*_: _Facts) -> bool:
    return True


def _bodies_of(golden: Seen, run: Seen, clients: Mapping[int, int]) -> dict[int, Body]:
    """Return each body of the golden recording, by its own number, with the other's number."""
    mine, theirs = (
        {client: [b for _, b in sorted(seen.bodies.items()) if b.client == client] for client in of}
        for seen, of in ((run, clients.values()), (golden, clients))
    )
    same = {
        body.number: other
        for client, bodies in theirs.items()
        for body, other in zip(bodies, mine[clients[client]], strict=False)
        if _name(body) == _name(other)
    }
    labels = {body.label for body in run.bodies.values()}
    taken = {body.number for body in same.values()}
    unused = max((*run.bodies, *golden.bodies), default=-1) + 1
    aligned = {}
    for number, body in golden.bodies.items():
        if number in same:
            to, label = same[number].number, same[number].label
        elif number not in taken and body.label not in labels:
            to, label = number, body.label
        else:
            to, label, unused = unused, f"{unused}_{_name(body)}", unused + 1
        aligned[number] = replace(body, number=to, label=label, client=clients[body.client])
    return aligned


def _name(body: Body) -> str:
    """Return a body's name in the engine."""
    return body.label.partition("_")[2]

"""Which simulations of two recordings correspond: those with the same bodies.

The numbers of clients say nothing: another connection before, even an unused one, shifts them.
"""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.seen import Seen

Clients = Mapping[int, int]
"""By a client of the golden recording, the number of the corresponding one in the checked one."""


def paired_clients(run: Seen, golden: Seen) -> dict[int, int]:
    """Return which client of the checked recording corresponds to each of golden's.

    Clients that share no body correspond in the order of their numbers; those that only golden has
    get numbers that the checked recording does not use.
    """
    mine = {body.label: body.client for body in run.bodies.values()}
    pairs: dict[int, int] = {}
    for body in golden.bodies.values():
        client = mine.get(body.label)
        if client is not None and client not in pairs.values():
            pairs.setdefault(body.client, client)
    rest = sorted(_clients(run) - set(pairs.values()))
    unused = max(_clients(run), default=-1) + 1
    for client in sorted(_clients(golden) - set(pairs)):
        if rest:
            pairs[client] = rest.pop(0)
        else:
            pairs[client], unused = unused, unused + 1
    return pairs


def _clients(seen: Seen) -> set[int]:
    """Return the numbers of all clients that anything is known of."""
    numbers = {body.client for body in seen.bodies.values()}
    numbers |= {settings.client for settings in seen.settings}
    numbers |= {held.client for held in seen.constraints}
    return numbers | {call.client for call in seen.calls}

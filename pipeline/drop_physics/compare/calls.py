"""Compares the calls of two scripts, in order."""

from __future__ import annotations

import re
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from drop_physics.compare.difference import INPUT, LED, Dated
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Site, order
from drop_physics.trace.history import Seen

FOLDER = re.compile(r"(?<=['\"])(?:/|[A-Za-z]:[/\\])(?:[^'\"]*[/\\])?")
"""Pattern of the folders in an absolute path in a call's arguments, which depend on the machine."""


@dataclass(frozen=True)
class OtherCall:
    """The first call that differs from the golden recording's."""

    value: Call | None
    """The call in the checked recording; None if that has no further call."""
    golden: Call | None
    """The call in the golden recording; None if that has no further call."""


class CallComparison:
    """Compares the calls of each simulation, chunk by chunk.

    The calling lines are not compared, and neither is the order of calls to different simulations,
    since threads take turns at random.

    Parameters
    ----------
    clients
        The checked recording's id of each client in the golden recording.
    """

    def __init__(self, clients: Mapping[int, int]) -> None:
        self._clients = clients
        self._waiting: dict[int, tuple[deque[Call], deque[Call]]] = defaultdict(
            lambda: (deque(), deque())
        )
        self._found: dict[int, OtherCall] = {}
        self._said: dict[Site, tuple[str, str]] = {}

    def add(self, run: Iterable[Call], golden: Iterable[Call]) -> None:
        """Compare the next calls of both recordings."""
        for call in run:
            if call.client in self._clients.values() and call.client not in self._found:
                self._waiting[call.client][0].append(call)
        for call in golden:
            client = self._clients.get(call.client)
            if client is not None and client not in self._found:
                self._waiting[client][1].append(call)
        for client, (mine, theirs) in self._waiting.items():
            while mine and theirs:
                pair = mine.popleft(), theirs.popleft()
                if self._does(pair[0]) != self._does(pair[1]):
                    self._found[client] = OtherCall(*pair)
                    mine.clear()
                    theirs.clear()

    def first(self) -> OtherCall | None:
        """Return the first call that differs so far."""
        found = [*self._found.values()]
        for mine, theirs in self._waiting.values():
            if mine or theirs:
                found.append(OtherCall(mine[0] if mine else None, theirs[0] if theirs else None))
        return min(found, key=_when, default=None)

    def _does(self, call: Call) -> tuple[object, ...]:
        """Return the parts of a call that determine its effect, without source line and folders."""
        if call.site not in self._said:
            self._said[call.site] = call.function, FOLDER.sub("", call.site.form)
        return *self._said[call.site], _comparable(call.numbers), bool(call.raised)


def _comparable(numbers: tuple[float, ...]) -> tuple[object, ...]:
    """Replace nan by a value that equals itself."""
    return tuple(number if number == number else None for number in numbers)


def _when(other: OtherCall) -> tuple[int, int]:
    return min(order(call.at) for call in (other.value, other.golden) if call is not None)


def call_before(run: Seen, first: Dated) -> Call | None:
    """Return the last call before a difference, which may be the cause."""
    found = None
    (step, phase, number), client, _ = first
    for piece in run.pieces():
        if piece.first > step:
            break
        for call in piece.calls:
            early = call.at.step < step or (call.at.step == step and phase != LED)
            if call.client == client and early and (phase != INPUT or call.at.call <= number):
                found = call
    return found

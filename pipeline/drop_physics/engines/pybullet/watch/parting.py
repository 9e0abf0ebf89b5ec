"""Finds the first call of PyBullet that a trial makes differently from the run before it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...watching.hidden import hiding
from ...watching.host import ScriptWatch
from .arguments import client_of, named
from .functions import MAKES_BODIES
from .intervene import Interventions

Call = Callable[..., Any]


class PartingCalls:
    """The trials of a run that calls of PyBullet tell apart.

    Parameters
    ----------
    host
        What watches the run, and forks.
    calls_of
        What returns what stands for a function, by name.
    """

    def __init__(self, host: ScriptWatch, calls_of: Callable[[str], Call]) -> None:
        assert host.forks is not None
        self._forks, self._calls_of = host.forks, calls_of
        trials = self._forks.trials
        self._known = Interventions([each for t in trials for each in t["interventions"]], _silent)

    @property
    def next_body(self) -> dict[int, int]:
        """The id that the next body gets, by client."""
        return self._known.next_body

    def of(self, name: str, call: Call) -> Call:
        """Return what stands before a watched function, at which trials may part."""
        forks = self._forks

        def parting(*args: Any, **kwargs: Any) -> Any:
            if not forks.pending:
                return call(*args, **kwargs)
            arguments, client = named(name, args, kwargs), client_of(name, args, kwargs)
            if forks.part(lambda trial: self._differs(trial, name, arguments, client)):
                return self._calls_of(name)(*args, **kwargs)
            result = call(*args, **kwargs)
            if name in MAKES_BODIES | {"connect", "resetSimulation"}:
                self._known.came(name, result if name == "connect" else client, result)
            return result

        return hiding(parting)

    def _differs(
        self, trial: dict[str, Any], name: str, arguments: dict[str, Any], client: int
    ) -> bool:
        return bool(trial["variation"] and name == "connect") or any(
            name in each.get("functions", ())
            and self._known.is_about(each, name, arguments, client)
            for each in trial["interventions"]
        )


def _silent(_: int) -> None:
    pass

"""The explained steps of the latest chunk, for rules that look at steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import pairs_of
from drop_physics.explain.joints import JointTelemetry
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.step_status import SampleStatus
from drop_physics.explain.steps import BodySteps, Steps
from drop_physics.explain.touching import STEPS
from drop_physics.physics.tree import States
from drop_physics.trace.calls import BODY_NAMES, Call
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

Column = Callable[[States], Float64]
"""A column of states."""
Rows = NDArray[np.intp]
LastStates = Mapping[int, Mapping[int, tuple[int, States]]]
"""The last step of each body and the state after it: by body id, then by the index of the body's
life, since ids are reused."""


class StepChunk:
    """The steps of a chunk, with the calls before them, and the contacts and commands in them."""

    def __init__(
        self,
        explained: ExplainedPiece,
        seen: Seen,
        driven: Sequence[JointTelemetry],
        earlier: LastStates,
    ) -> None:
        self.piece, self.judged, self.batches = (
            explained.piece,
            explained.bodies,
            explained.batches,
        )
        """The calls and samples; the motion of each body, by body id; the steps of equal bodies."""
        self.pairs = pairs_of(explained)
        """The contact points."""
        self.driven = driven
        """The joints of each body, with their commands."""
        self._explained, self._settings, self._earlier = explained, seen.settings, earlier

    def came(self, steps: Steps, parts: Iterable[tuple[int, BodySteps]], column: Column) -> Float64:
        """Return a quantity of the bodies' states one step earlier, shape (n, k); nan if unknown.

        The quantity is nan if the body had no previous step, or was loaded since. `parts` has the
        index of each body's first row, with the body's steps, in order.
        """
        values = np.array(column(steps.after))
        came, before = np.vstack([values[:1], values[:-1]]), np.append(-1, steps.steps[:-1])
        for row, part in parts:
            number, ends = part.body.number, dict(self._earlier.get(part.body.number, {}))
            for _, each in self.intervals(number):
                if each is part:
                    break
                ends[each.config.life] = int(each.steps[-1]), each.after.at(np.array([-1]))
            before[row], end = ends.get(part.config.life, (-1, None))
            if end is not None and column(end).shape[1:] == values.shape[1:]:
                came[row] = column(end)[0]
            else:
                came[row] = values[row]
        came[steps.steps - before != 1] = np.nan
        return came

    def last_states(self) -> LastStates:
        """Return the last states of all bodies so far, for the next chunk."""
        found = dict(self._earlier)
        for _, each in self.intervals():
            end = int(each.steps[-1]), each.whole.after.at(np.array([each.rows.stop - 1]))
            found[each.body.number] = {each.config.life: end}
        return found

    def body_of(self, call: Call) -> Body | None:
        """Return the body that a call's arguments identify; None without one."""
        place = next((at for name in BODY_NAMES if (at := call.site.places.get(name))), None)
        if place is None:
            return None
        came = self.piece.calls.body_at(call, int(call.numbers[place.start]))
        return None if came is None else came.body

    def intervals(self, *bodies: int) -> Iterator[tuple[SampleStatus, BodySteps]]:
        """Yield the steps of the bodies with the given ids, or of all bodies."""
        for number in bodies or self.judged:
            for steps in self.judged[number].intervals if number in self.judged else ():
                if len(steps):
                    yield self.judged[number], steps

    def touching(self, bodies: Int64, steps: Int64) -> Flags:
        """Flag the bodies that have a contact point in the given step."""
        pairs = self.pairs
        return np.isin(bodies * STEPS + steps, pairs.body * STEPS + pairs.step[:, None])

    def steps_at(self, bodies: Int64, steps: Int64) -> Iterator[tuple[Steps, Rows, Rows]]:
        """Yield the batches that contain the given steps of bodies.

        `bodies` and `steps` have the shape (n,).
        """
        for batch, _, its, at in self._explained.steps_at(bodies, steps):
            yield batch.whole, its, at

    def settings(self, client: int) -> Mapping[str, float | Sequence[float]]:
        """Return the settings of a simulation."""
        told = [each for each in self._settings if each.client == client]
        before = [each for each in told if each.at.step < self.piece.end]
        return (before or told)[-1].values

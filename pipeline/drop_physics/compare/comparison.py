"""Decides whether two recordings show the same physics, and finds the first difference.

Inputs are compared until a sample differs: later, a script that controls by its measurements may
react to the difference. Calls are reported, but only their effects count. Motion that is not
recorded, such as that of soft bodies, is not compared: recordings with such a body never count as
the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from drop_physics.compare.calls import CallComparison, OtherCall, call_before
from drop_physics.compare.difference import (
    Dated,
    Difference,
    Largest,
    Setting,
    Side,
    earliest,
)
from drop_physics.compare.inputs import (
    input_differences,
    script_settings,
    script_versions,
)
from drop_physics.compare.pairing import pairing
from drop_physics.compare.samples import SampleComparison
from drop_physics.compare.scenarios import engine_versions, scenario_differences
from drop_physics.compare.tolerance import tolerance_of
from drop_physics.explain.times import StepTimes
from drop_physics.trace.calls import Call
from drop_physics.trace.history import Piece, Seen

TIMESTEPS = ("timestep_s", "engine.timestep_s", "engine.fixedTimeStep")


@dataclass(frozen=True)
class Comparison:
    """The result of comparing two recordings."""

    of_drop: bool
    """Whether both recordings are of a drop."""
    differences: list[Difference]
    """Settings of a drop, or inputs of a script that differed before any sample did: bodies, engine
    settings, masses … For a script, differences of inputs alone do not count as a difference."""
    first: Difference | None
    """The first difference of a sample, or the first body that only one recording has; None if
    there is none, or nothing was compared."""
    call_before: Call | None
    """The last call before the first difference."""
    other_call: OtherCall | None
    """The first call that differs from the golden recording's; None if none does. A different call
    alone is no difference in physics."""
    largest: list[Largest]
    """The largest difference of each body and quantity, if there is any."""
    largest_difference_m: float | None
    """Largest distance between positions of a link, over all samples common to both; None if there
    are none."""
    part_at: int | None
    """The first step with a state that is not equal bit for bit."""
    not_compared: list[str]
    """Bodies that are not compared, so that the recordings cannot count as the same: soft bodies,
    bodies with links that PyBullet does not report, and bodies that only one recording has, or that
    have other joints in the other one."""
    script: list[Setting]
    """Differences of the script: name, digest of the text, arguments, seed. Not a difference in
    physics."""
    versions: list[Setting]
    """Versions of the software with which the recordings were made, if they differ: not a
    difference in physics."""
    unseeded: list[str]
    """Calls that drew unseeded random numbers in either recording."""
    real_time: bool
    """Whether either run requested real-time simulation, which follows a clock."""
    unpaired: Sequence[str] = ()
    """Bodies that only one recording has, or that have other joints in the other one."""

    @property
    def same(self) -> bool:
        """True if both recordings show the same physics; False if nothing could be compared."""
        alike = self.first is None and not self.not_compared
        alike &= not (self.of_drop and self.differences)
        return alike and self.largest_difference_m is not None


def compare(run: Side, golden: Side, *, tolerance_m: float = 0.0) -> Comparison:
    """Compare a recording with the golden one: inputs, then samples.

    Parameters
    ----------
    run, golden
        The two recordings, both of a drop or both of a script.
    tolerance_m
        Allowed difference of positions [m]; 0 requires equal bits, except for a drop in contact.
    """
    pairs = pairing(run.seen, golden.seen)
    if run.drop is not None and golden.drop is not None:
        settings = scenario_differences(run.drop, golden.drop)
        inputs: list[Dated] = []
        versions = engine_versions(run.drop, golden.drop)
    else:
        settings, versions = [], script_versions(run, golden)
        inputs = sorted(
            input_differences(run.seen, golden.seen, pairs), key=lambda difference: difference.when
        )
    at_start = [each.difference for each in inputs if each.when.step == 0]
    comparable = not any(each.column in TIMESTEPS for each in (*settings, *at_start))
    calls = CallComparison(pairs.clients)
    samples = SampleComparison(run.seen, golden.seen, pairs, tolerance_of(run, golden, tolerance_m))
    for mine, theirs in _pieces(run.seen, golden.seen):
        calls.add(mine.calls, theirs.calls)
        if comparable:
            samples.add(mine, theirs)
    if comparable:
        samples.end()
    parted = samples.parted
    inputs = [each for each in inputs if parted is None or each.when < parted]
    only = [each for each in inputs if each.difference.column == "there"]
    first = earliest(samples.first, *(only if samples.shared else []))
    largest = [each for _, each in sorted(samples.largest.items())]
    metres = [each.difference for each in largest if each.quantity == "position"]
    numbers = {*run.seen.bodies, *pairs.bodies} - pairs.common.keys()
    alone = [
        run.seen.bodies[number].label if number in run.seen.bodies else pairs.label(number)
        for number in sorted(numbers)
    ]
    unpaired = [*alone, *samples.unlike.values()]
    not_seen = [*_not_seen(run.seen), *_not_seen(golden.seen)]
    return Comparison(
        of_drop=run.drop is not None,
        differences=[*settings, *(_told(each, run.seen) for each in inputs)],
        first=None if first is None else _told(first, run.seen),
        call_before=None if first is None else call_before(run.seen, first),
        other_call=calls.first(),
        largest=largest,
        largest_difference_m=max(metres, default=0.0) if samples.shared else None,
        part_at=None if parted is None else parted.step,
        not_compared=list(dict.fromkeys([*not_seen, *unpaired])),
        script=[*script_settings(run, golden)],
        versions=[*versions],
        unseeded=[*dict.fromkeys((*run.seen.unseeded, *golden.seen.unseeded))],
        real_time=run.seen.real_time or golden.seen.real_time,
        unpaired=unpaired,
    )


def _pieces(run: Seen, golden: Seen) -> Iterator[tuple[Piece, Piece]]:
    """Yield chunks of both recordings for the same steps."""
    sides, steps = (run.sampled, golden.sampled), min(run.piece_steps(), golden.piece_steps())
    for first in range(
        min(side.first for side in sides), max(side.last for side in sides) + 1, steps
    ):
        mine, theirs = (side.piece(first, first + steps) for side in sides)
        yield mine, theirs


def _not_seen(seen: Seen) -> Iterator[str]:
    """Return the names of bodies whose motion is not, or not fully, recorded."""
    for body in seen.bodies.values():
        if body.soft or body.hides_links:
            yield body.label


def _told(dated: Dated, run: Seen) -> Difference:
    """Return a difference with the simulated time of its step added."""
    return replace(dated.difference, time_s=StepTimes(run, dated.client).of(dated.when.step))

"""Compares PyBullet runs by their call logs, as PyBullet's full state cannot be read or set."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.compare.paired import PairedBody, moving_alone, paired_bodies
from drop_physics.engines.pybullet.logged import BODY, FILES, LogError, LogOf, renumbered
from drop_physics.engines.pybullet.replayed import Replayer
from drop_physics.errors import DropError
from drop_physics.experiments.swap.answer import ProvedDifference
from drop_physics.experiments.swap.calls import WhyCalls
from drop_physics.explain.times import StepTimes
from drop_physics.stages.diff.sides import RunSide
from drop_physics.stages.rerun.no_step import no_step
from drop_physics.temporary import temporary_folder
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body
from drop_physics.trace.logs import LoggedCall, Made


def answered_by_calls(
    a: RunSide, b: RunSide, tolerance: float, tell: Callable[[int], None]
) -> tuple[ProvedDifference, int]:
    """Explain how two runs differ by replaying calls; return also the number of replays.

    Raises
    ------
    RecordingError
        If a run has no step.
    DropError
        If a replaying process ends early.
    """
    with temporary_folder() as folder:
        (mine, first), (theirs, second) = (logged(side) for side in (a, b))
        logs = first, second
        theirs, twin = renumbered(logs[0], logs[1], theirs)
        bodies, both = _bodies(a, b, logs[0], logs[1], twin)
        moves = moving_alone(a.recording.seen, b.recording.seen, [*both.values()])
        joints = {number: [joint.name for joint in x.joints] for number, (x, _) in both.items()}
        names = {number: body.name for number, body in bodies}
        mine, theirs = (_told(log, names, joints) for log in (mine, theirs))
        lengths = steps_of(a), steps_of(b)
        times = StepTimes(a.recording.seen, 0)
        times_s = times.of_all(np.arange(1, lengths[0] + 1))
        folders = [Path(each.target).absolute().parent for each in (b, a)]
        with Replayer(a.python, a.environment, folders) as replayer:

            def states(calls: Sequence[LoggedCall], steps: int) -> dict[int, Float64] | None:
                tell(replayer.jobs)
                return replayer.states(placed(calls, Path(folder)), steps)

            answer = WhyCalls(
                mine, theirs, bodies, lengths, times_s, states, tolerance, moves
            ).answer()
            return answer, replayer.jobs


def logged(side: RunSide) -> tuple[list[LoggedCall], LogOf]:
    """Return the call log of a run, and its source, in which ids can be resolved."""
    log = LogOf(side.recording.seen.calls, side.files)
    try:
        return log.logged(), log
    except LogError as error:
        raise DropError(
            "a call of {name} cannot be made again, as not all of it is recorded: {call}",
            name=side.name,
            call=str(error),
        ) from None


def steps_of(side: RunSide) -> int:
    """Return the number of steps of a run.

    Raises
    ------
    RecordingError
        If the run has no step.
    """
    steps = max(side.recording.seen.samples.values(), default=0) - 1
    if steps < 1:
        how = str((side.recording.ended or {}).get("ended", ""))
        raise no_step(Path(side.target).name, how)
    return steps


def _bodies(
    a: RunSide, b: RunSide, mine: LogOf, theirs: LogOf, twin: dict[Made, Made]
) -> tuple[list[tuple[int, PairedBody]], dict[int, tuple[Body, Body]]]:
    """Pair the bodies of both runs; also return their numbers in the call logs."""
    of_a, of_b = (
        {made: _body_of(side, call) for made, call in log.made if made[0] == BODY}
        for side, log in ((a, mine), (b, theirs))
    )
    pairs = [
        (made[1], x, y)
        for other, made in twin.items()
        if (x := of_a.get(made)) is not None and (y := of_b.get(other)) is not None
    ]
    seen = a.recording.seen, b.recording.seen
    steps = min(steps_of(a), steps_of(b))
    found = []
    for number, x, y in sorted(pairs, key=lambda pair: pair[0]):
        found += [(number, body) for body in paired_bodies(*seen, [(x, y)], steps)]
    return found, {number: (x, y) for number, x, y in pairs}


def _body_of(side: RunSide, call: Call) -> Body | None:
    came = side.recording.seen.calls.body_at(call, int(call.result))
    return None if came is None else came.body


def placed(log: Sequence[LoggedCall], folder: Path) -> list[LoggedCall]:
    """Write files that the calls load, if they are gone; return the log with valid paths."""
    found = []
    for each in log:
        if each.content is None:
            found.append(each)
            continue
        name = next(n for n in FILES if n in each.given)
        path, content = str(each.given[name]), each.content
        there = Path(path)
        if not (there.is_file() and there.read_bytes() == content):
            digest = hashlib.sha256(content).hexdigest()[:16]
            there = folder / digest / Path(path.partition("#")[0]).name
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(content)
        found.append(replace(each, given={**each.given, name: str(there)}))
    return found


def _told(
    log: Sequence[LoggedCall], names: Mapping[int, str], joints: Mapping[int, Sequence[str]]
) -> list[LoggedCall]:
    """Return a call log in which the bodies and joints of calls have names."""
    found = []
    for each in log:
        made = each.makes or next(
            (
                (value[0], value[1])
                for value in each.given.values()
                if isinstance(value, list) and len(value) == 2 and value[0] == BODY
            ),
            None,
        )
        about = names.get(made[1], "") if made and made[0] == BODY else ""
        joint = each.given.get("jointIndex")
        if made and isinstance(joint, int) and 0 <= joint < len(joints.get(made[1], ())):
            about = f"{joints[made[1]][joint]} ({about})"
        found.append(replace(each, about=about))
    return found

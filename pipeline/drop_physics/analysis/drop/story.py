"""A drop from recording to verdict: every body explained, and what its scenario adds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import polars as pl

from drop_physics.analysis import story
from drop_physics.analysis.drop.analysis import fall_analysis_of
from drop_physics.analysis.drop.results import DropAnalysis, FallAnalysis
from drop_physics.analysis.results import Analysis, BodyAnalysis, BodyFlight, Explained, Unexplained
from drop_physics.messages import Message
from drop_physics.report import EngineReport
from drop_physics.scenario import Scenario
from drop_physics.seen.events import Body
from drop_physics.seen.history import Seen
from drop_physics.states import BODY


def drop_analysis_of(
    scenario: Scenario,
    engine: EngineReport,
    seen: Seen,
    states: pl.DataFrame,
    *,
    at_s: Sequence[float] = (),
) -> DropAnalysis:
    """Analyze the recording of a drop.

    Parameters
    ----------
    scenario
        What was dropped, and how.
    engine
        What the engine reported about the body and the floor.
    seen
        What was recorded.
    states
        Its samples, a row per sample and part in the order of steps.
    at_s
        Times at which to break down the error, and to report steps as sums [s]; without any, the
        error at 0.3 s where that is in free flight.

    Raises
    ------
    ScenarioError
        If a time lies outside the recording.
    """
    fall = fall_analysis_of(scenario, engine, states, seen.contacts, at_s=at_s)
    seen = replace(seen, samples={0: len(fall.table)})
    if scenario.engine == "bullet" and scenario.stepped:
        whole = story.analysis_of(seen, {}, at_s=at_s, sums_at_s=at_s, answers=())
        body = next(each for each in whole.bodies if each.id == BODY)
        of_body = vars(fall) | {
            "segments": body.segments,
            "explained": _until_the_last(whole.explained, fall, scenario.timestep_s),
        }
    else:
        whole, of_body = _without_sum(seen, fall), vars(fall)
    return DropAnalysis(**(vars(whole) | of_body | {"origin": None, "kind": "drop"}))


def _until_the_last(explained: Explained, fall: FallAnalysis, timestep_s: float) -> Explained:
    """Return the same until the last explained sample, as of a drop, not the first other one."""
    if explained.until_s is None:
        return replace(explained, until_s=float(fall.table["time_s"][-1]))
    step = round(explained.until_s / timestep_s)
    why: str = Message("at sample {step} {why}", step=step, why=explained.why)
    if step == _first_unexplained(fall, timestep_s):  # in the words of the fall
        why = fall.explained.why or why
    return replace(explained, until_s=(step - 1) * timestep_s if step else None, why=why)


def _first_unexplained(fall: FallAnalysis, timestep_s: float) -> int:
    until_s = fall.explained.until_s
    return 0 if until_s is None else round(until_s / timestep_s) + 1


def _without_sum(seen: Seen, fall: FallAnalysis) -> Analysis:
    """Return what the law of one body in flight says of it: its engine's step has no sum here."""
    bodies = [_body(seen.bodies[number], fall) for number in sorted(seen.bodies)]
    return Analysis(
        origin=None,
        engine=fall.engine,
        samples=len(fall.table),
        explained=fall.explained,
        bodies=bodies,
        findings=fall.findings,
        by_body={BODY: fall.explained},
        table=fall.table,
    )


def _body(body: Body, fall: FallAnalysis) -> BodyAnalysis:
    falls, counts = body.number == BODY, dict.fromkeys(fall.segments, 0)
    unexplained = []
    if falls and fall.explained.why is not None:
        first = _first_unexplained(fall, fall.scenario["timestep_s"])
        unexplained = [Unexplained("engine", fall.segments["unexplained"], first, None)]
    return BodyAnalysis(
        name=body.name,
        label=body.label,
        id=body.number,
        soft=False,
        links=list(body.links),
        mass_kg=fall.engine.mass_kg if falls else 0.0,
        segments=fall.segments if falls else counts | {"still": len(fall.table)},
        flights=[BodyFlight(**vars(flight), at=[]) for flight in fall.flights if falls],
        contacts=[],
        unexplained=unexplained,
        energy=None,
        momentum=None,
        joints=[],
        touches=[],
        at=[],
    )

"""Analyzes a drop: explains its bodies, and compares the fall with theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drop_physics.analysis.results import Analysis, BodyAnalysis, Explained, Unexplained
from drop_physics.analysis.story import Story
from drop_physics.drop.analysis import Fall, FallAnalyzer
from drop_physics.drop.case import DropCase
from drop_physics.drop.findings import findings
from drop_physics.drop.results import DropAnalysis
from drop_physics.drop.samples import samples_seen
from drop_physics.engine_report import EngineReport
from drop_physics.explain.rows import MOST_ROWS
from drop_physics.messages import Message
from drop_physics.physics.laws.lookup import law_for
from drop_physics.scenario import Scenario
from drop_physics.trace.history import Seen
from drop_physics.trace.states import BODY

UNSEEN = Message(
    "it may have touched: of several substeps PyBullet reports only the contacts of the last"
)
EARLY = Message(
    "MuJoCo's solver may stop before its forces balance; with --solver-residual 0, and "
    "without --solver-iterations, they do"
)


def drop_analysis_of(
    scenario: Scenario,
    engine: EngineReport,
    seen: Seen,
    *,
    at_s: Sequence[float] = (),
    whole: bool = False,
) -> DropAnalysis:
    """Analyze the recording of a drop.

    Parameters
    ----------
    scenario
        The scenario of the drop.
    engine
        The engine's report on the body and the floor.
    seen
        The recorded data.
    at_s
        Times at which the error is broken down, and steps are reported as sums [s]; if empty, only
        the error at 0.3 s, if that is in free flight.
    whole
        Whether the table has all samples, even of a long recording.

    Raises
    ------
    ScenarioError
        If a time lies outside the recording.
    """
    samples = seen.sampled.last + 1
    seen = replace(seen, samples={0: samples}, machine=engine.machine or "")
    other = None if scenario.engine == "bullet" else law_for(scenario, engine)
    case = DropCase(scenario, engine, seen)
    falling = FallAnalyzer(case, at_s=at_s, whole=whole or samples <= MOST_ROWS)
    story = Story(
        seen,
        {},
        at_s=at_s,
        sums_at_s=at_s,
        asked=False,
        other=other,
        also=lambda piece: falling.add(samples_seen(seen, piece)),
    )
    walked, fall = story.analysis(), falling.fall()
    walked = _checked(walked, fall)
    (body,) = (each for each in walked.bodies if each.id == BODY)
    of_drop = vars(fall.analysis) | {
        "origin": None,
        "kind": "drop",
        "segments": body.segments,
        "findings": findings(replace(fall, mismatch_step=_mismatch_step(fall, body))),
        "flights": body.flights,
        "explained": _explained(walked.by_body[BODY], body, case),
    }
    return DropAnalysis(**(vars(walked) | of_drop))


def _mismatch_step(fall: Fall, body: BodyAnalysis) -> int | None:
    """Return the first covered sample that does not follow from the previous one."""
    left = [each.first_step for each in body.unexplained if each.reason == "remainder"]
    if not fall.case.is_rigid and fall.case.scenario.stepped:
        return None  # a mass that a call changed leaves the inertia of a first push
    if (departs := fall.course.air.departs) is not None:
        left.append(departs)
    return min(left, default=None)


def _checked(whole: Analysis, fall: Fall) -> Analysis:
    """Return the analysis, with a check of samples before any step against the release.

    A sample that differs from the release counts as unexplained.
    """
    (body,) = (each for each in whole.bodies if each.id == BODY)
    segments, left = dict(body.segments), {each.reason: each for each in body.unexplained}
    case, first, altered = fall.case, 0, int(not fall.case.released)
    if case.scenario.stepped:
        segments["set"] -= altered
        body = replace(body, segments=segments)
    else:  # nothing is a step
        first, altered = fall.course.altered or (0, 0)
        left, still = {}, case.samples - altered
        segments |= dict.fromkeys(segments, 0) | {"still": still}
        body = replace(body, flights=[], contacts=[], energy=None, momentum=None, at=[])
    if altered:
        other = left.get("remainder", Unexplained("remainder", 0, 0, None))
        left["remainder"] = replace(other, samples=other.samples + altered, first_step=first)
    segments["unexplained"] = sum(each.samples for each in left.values())
    body = replace(body, segments=segments, unexplained=[*left.values()])
    of = whole.by_body[BODY].of
    explained = replace(whole.by_body[BODY], samples=of - segments["unexplained"])
    bodies = [body if each.id == BODY else each for each in whole.bodies]
    return replace(whole, bodies=bodies, by_body=whole.by_body | {BODY: explained})


def _stops_early(case: DropCase) -> bool:
    """Return whether MuJoCo's solver may stop before contact forces balance."""
    exact = case.scenario.solver_residual == 0 and case.scenario.solver_iterations is None
    return case.scenario.engine == "mujoco" and not case.hides_contacts and not exact


def _explained(explained: Explained, body: BodyAnalysis, case: DropCase) -> Explained:
    """Return the explained part of a drop, which ends at the first unexplained sample."""
    first = min(body.unexplained, key=lambda each: each.first_step, default=None)
    if first is None:
        return replace(explained, until_s=case.end_s, why=None)
    step = first.first_step
    why = Message(
        "what {engine} reports of the step does not add up to it", engine=case.engine_name
    )
    if first.reason == "substeps" and case.is_rigid:
        why = UNSEEN
    elif first.reason == "engine" and _stops_early(case):
        why = EARLY
    return replace(
        explained,
        until_s=(step - 1) * case.timestep_s if step else None,
        why=Message("at sample {step} {why}", step=step, why=why),
    )

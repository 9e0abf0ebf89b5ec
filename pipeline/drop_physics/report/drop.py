"""The report of a drop: from release to rest, the terms of the position error, the findings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.explain.cause_names import cause_in_words
from drop_physics.fields import LARGE, counted, decimals, engineering, fraction
from drop_physics.messages import Message, joined
from drop_physics.report.blocks import (
    Column,
    DataTable,
    Fact,
    Facts,
    FindingList,
    Report,
    Section,
    Words,
)
from drop_physics.report.bodies import sum_of
from drop_physics.report.flights import contacts, flights
from drop_physics.report.words import EXPLAINED, TERMS, kinds_of_samples, millimetres
from drop_physics.scenario import ENGINES, EXACT_INTEGRATORS

if TYPE_CHECKING:
    from drop_physics.drop.results import Bounce, Coverage, DropAnalysis, Moment, Rest


def report_of_drop(analysis: DropAnalysis, *, verbose: bool = False) -> Report:
    """Report a drop, from its release until it rests."""
    last = analysis.table.row(-1, named=True)
    body = Path(analysis.scenario["body"]).name
    centre = Message(
        "after {time:.4g} s its centre is at {height} m",
        time=last["time_s"],
        height=decimals(last["simulated_m"], 4),
    )
    facts = [*_impact(analysis), *_bounces(analysis), *_rest(analysis), *_energy(analysis)]
    if analysis.explained.why is not None or verbose:
        facts.append(_titled(EXPLAINED, _explained(analysis)))
    if verbose and analysis.coverage.samples < analysis.coverage.of:
        facts.append(_titled(Message("Covered"), _covered(analysis.coverage)))
    sections = [
        Section([Words(centre)], apart=False),
        *(_moment(moment, analysis.scenario, verbose=verbose) for moment in analysis.at),
        Section([Facts(facts, _TITLE)]),
    ]
    if verbose:
        sections += [*flights(analysis.bodies), *contacts(analysis.bodies[:1])]
        sections += [sum_of(body, each) for body in analysis.bodies for each in body.at]
    most = len(analysis.findings) if verbose else MOST_FINDINGS
    found = FindingList(analysis.findings, most, analysis.left_out, analysis.sources)
    sections.append(Section([found], apart=False))
    return Report(verdict=Words(_dropped(analysis, body), key=body), sections=sections)


def _dropped(analysis: DropAnalysis, body: str) -> Message:
    """Describe the dropped body, its height, and its engine unless that is PyBullet."""
    scenario = analysis.scenario
    values = {
        "body": body,
        "height": decimals(analysis.table["simulated_m"][0], 4),
        "timestep": fraction(scenario["timestep_s"]),
    }
    if scenario["engine"] == "bullet":
        dropped = Message("{body} dropped from {height} m, timestep {timestep} s", **values)
    else:
        integrator = f" ({scenario['integrator']})" if scenario["integrator"] else ""
        dropped = Message(
            "{body} dropped in {engine} from {height} m, timestep {timestep} s",
            engine=ENGINES[scenario["engine"]] + integrator,
            **values,
        )
    damping = scenario["linear_damping"]
    if damping is None and scenario["engine"] != "bullet":
        return dropped
    if damping is None:
        return dropped + Message(", damping default")
    return dropped + Message(", damping {damping:g}", damping=damping)


def _covered(coverage: Coverage) -> Message:
    if coverage.samples == 0:
        return Message("no sample of {of:,}: {why}", of=coverage.of, why=coverage.why)
    if coverage.samples == 1:
        return Message("sample 0 of {of:,}: {why}", of=coverage.of, why=coverage.why)
    return Message(
        "samples 0 to {last} of {of:,}: {why}",
        last=coverage.samples - 1,
        of=coverage.of,
        why=coverage.why,
    )


def _titled(title: str, words: str) -> Fact:
    return Fact(title, words, "bold")


def _moment(moment: Moment, scenario: dict[str, Any], *, verbose: bool) -> Section:
    heights = Message(
        "simulated {simulated} m, free fall {free_fall} m, difference {difference} m",
        simulated=decimals(moment.simulated_m, 4),
        free_fall=decimals(moment.free_fall_m, 4),
        difference=decimals(moment.error_m, 4, "+"),
    )
    at = Message("At {time:.4g} s (step {step})", time=moment.time_s, step=moment.step)
    title = Words(joined(": ", [at, heights]), key=at, indent="  ")
    terms = moment.terms_m
    if terms is None:
        why = Message("not broken down: the law of free flight does not cover it")
        return Section([title, Words(why, margin="  ")])
    reasons = {
        "timestep": Message("Euler moves with the end-of-step velocity"),
        "damping": _drag(scenario, bool(terms.damping)),
        "interaction": Message("timestep × damping"),
        "rounding": Message("double precision"),
        "total": "",
    }
    if scenario["integrator"] in EXACT_INTEGRATORS:
        reasons["timestep"] = Message("none: the integrator is exact where only gravity acts")
    values_m = [getattr(terms, name, moment.error_m) for name in reasons]
    # What is below the digits shown is of interest to who asks for all.
    lengths = (f"{millimetres(m) if verbose else decimals(m * 1e3, 4, '+')} mm" for m in values_m)
    columns = [
        Column("", [TERMS[name] for name in reasons], least=12),
        Column("", [*lengths], right=True, least=13, gap=1),
        Column("", [*reasons.values()], gap=3, style="dim", wraps=True),
    ]
    return Section([title, DataTable(columns, has_heads=False, has_total=True, margin="  ")])


def _drag(scenario: dict[str, Any], is_felt: bool) -> Message:
    if scenario["engine"] != "bullet":
        engine = ENGINES[scenario["engine"]]
        return Message("none: {engine} does not damp by itself", engine=engine)
    if scenario["linear_damping"] is None and is_felt:
        return Message("Bullet's default drag; independent of timestep")
    return Message("drag; independent of timestep")


def _impact(analysis: DropAnalysis) -> list[Fact]:
    impact = analysis.impact
    if impact is None:
        return [_titled(Message("Impact"), _no_impact(analysis))]
    predicted = _times(impact.time_simulated_s, impact.time_free_fall_s, impact.time_damped_s)
    step_mm = impact.speed_m_s * analysis.scenario["timestep_s"] * 1e3
    step_mm /= analysis.scenario["substeps"] or 1
    arrives = Message(
        "at {speed} m/s, {step_mm} mm a step; first contact at step {step}",
        speed=decimals(impact.speed_m_s, 3),
        step_mm=decimals(step_mm, 1),
        step=impact.step,
    )
    if impact.penetration_m is not None:
        depth = decimals(impact.penetration_m * 1e3, 1)
        if impact.lowest_step > impact.step:
            arrives += Message(
                ", {depth} mm deep at most (step {step})", depth=depth, step=impact.lowest_step
            )
        else:
            arrives += Message(", {depth} mm deep", depth=depth)
    unknown = Message("theory gives no time: the body is tilted, or did not fall")
    return [_titled(Message("Impact"), predicted or unknown), _titled("", arrives)]


def _no_impact(analysis: DropAnalysis) -> Message:
    landing = analysis.landing
    words = Message("none in {time:.4g} s", time=analysis.table["time_s"][-1])
    if "contact" in analysis.table["phase"]:
        words = Message(
            "time unknown: of several substeps PyBullet reports only the last one's contact"
        )
    if landing is None:
        return words
    inside_m = (analysis.engine.rest_height_m or 0.0) - analysis.table["simulated_m"][-1]
    if inside_m > 0:
        depth = decimals(inside_m * 1e3, 1)
        words += Message(", and {depth} mm inside the floor at the end", depth=depth)
    return joined("; ", [words, _times(None, landing.time_free_fall_s, landing.time_damped_s)])


def _times(simulated_s: float | None, free_s: float | None, damped_s: float | None) -> Message:
    times = (
        (Message("simulated"), simulated_s),
        (Message("free fall"), free_s),
        (Message("damped fall"), damped_s),
    )
    return joined(
        ", ",
        [
            Message("{name} {time:.4f} s", name=name, time=time_s)
            for name, time_s in times
            if time_s is not None
        ],
    )


def _bounces(analysis: DropAnalysis) -> list[Fact]:
    explained = [bounce for bounce in analysis.bounces if bounce.effective_restitution is not None]
    facts = []
    if analysis.impact and analysis.engine.pair_restitution and (analysis.engine.substeps or 1) > 1:
        why = Message("not counted: of substeps PyBullet reports only the last contact")
        facts.append(_titled(Message("Bounces"), why))
    for number, bounce in enumerate(explained[:_MOST_BOUNCES], start=1):
        title = Message("Bounce {number}", number=number)
        facts.append(_titled(title, _bounce(analysis, bounce)))
    more = len(explained) - _MOST_BOUNCES
    if more > 0:
        bounces = counted(more, "more bounce")
        facts.append(_titled("", Message("and {bounces}: see --json", bounces=bounces)))
    if analysis.tumbled_step is not None:
        title = Message("Tumbles") if analysis.tumbles else Message("Not flat")
        tumbling = analysis.bounces[len(explained) :]
        facts.append(_titled(title, _tumbles(analysis, analysis.tumbled_step, tumbling)))
    return facts


def _tumbles(analysis: DropAnalysis, step: int, bounces: Sequence[Bounce]) -> Message:
    time_s = step * analysis.scenario["timestep_s"]
    words = Message(
        "from t = {time:.4g} s (step {step}) on: measured, not predicted", time=time_s, step=step
    )
    if not bounces:
        return words
    highest_mm = max(bounce.apex_m for bounce in bounces) * 1e3
    up_to = Message(
        "{bounces}, up to {highest} mm",
        bounces=counted(len(bounces), "more bounce"),
        highest=decimals(highest_mm, 1),
    )
    return joined("; ", [words, up_to])


def _bounce(analysis: DropAnalysis, bounce: Bounce) -> Message:
    apex = _positive_mm(bounce.apex_m)
    body, floor = analysis.engine.restitution, analysis.engine.floor_restitution
    if bounce.predicted_apex_m is None:
        said = Message("rises {apex} mm in this recording", apex=apex)
    elif body is None or floor is None:
        said = Message("rises {apex} mm", apex=apex)
    else:
        asked = f"{body * floor:.4g} ({body:g} × {floor:g})"
        said = Message(
            "rises {apex} mm; a restitution of {asked} alone gives {predicted} mm",
            apex=apex,
            asked=asked,
            predicted=_positive_mm(bounce.predicted_apex_m),
        )
    effective = bounce.effective_restitution
    said += Message(". Effective restitution {effective:.4f}", effective=effective)
    if bounce.correction_m_s is not None and abs(bounce.correction_m_s) >= 5e-4:
        said += Message(
            ": the position correction changes the rebound by {change:+.3f} m/s",
            change=bounce.correction_m_s,
        )
    if bounce.uncorrected_apex_m is not None and analysis.scenario["contact_erp"] != 0:
        said += Message(
            "; with --contact-erp 0 --solver-residual 0 it rises {apex} mm",
            apex=_positive_mm(bounce.uncorrected_apex_m),
        )
    return said


def _positive_mm(length_m: float) -> str:
    """Format a length in millimetres; a length that rounds to zero has no sign."""
    return decimals(round(length_m * 1e3, 1) + 0.0, 1)


def _rest(analysis: DropAnalysis) -> list[Fact]:
    rest = analysis.rest
    if rest is None:
        return []
    height = Message(
        "{height} m: the position is the body's centre, not its underside",
        height=decimals(rest.height_m, 4),
    )
    facts = [_titled(Message("Rest"), height)]
    if rest.settled_step is None:
        keeps = Message("it keeps creeping or turning until the end of the recording")
        facts.append(_titled("", keeps))
    return [*facts, _titled("", _off(rest))]


def _off(rest: Rest) -> Message:
    """Describe the distance of a body's rest position from the expected one, with the reason."""
    if rest.expected_m is None or rest.error_m is None:
        return Message("no theory gives the height at rest in this orientation")
    error = Message(
        "{error} µm off {expected:g} m",
        error=decimals(rest.error_m * 1e6, 2, "+"),
        expected=rest.expected_m,
    )
    if rest.sinks_m is not None:
        why = Message(
            "MuJoCo's soft contact (solref, solimp) carries it at a depth of {depth} µm",
            depth=decimals(rest.sinks_m * 1e6, 2),
        )
    elif rest.terms_m is None:
        return error + Message("; the contact law does not cover this landing")
    else:
        terms = rest.terms_m
        why = Message(
            "{slop} slop, {solver} early stop, {settling} settling",
            slop=_micrometres(terms.slop),
            solver=_micrometres(terms.solver),
            settling=_micrometres(terms.settling),
        )
    return joined(": ", [error, why])


def _micrometres(length_m: float) -> str:
    return decimals(round(length_m * 1e6, 2) + 0.0, 2, "+")


def _energy(analysis: DropAnalysis) -> list[Fact]:
    energy = analysis.bodies[0].energy
    if energy is None:
        return []
    scale = max(abs(energy.start_j), abs(energy.end_j))

    def joules(j: float, sign: str = "") -> str:
        if scale >= LARGE:
            return engineering(j, sign)
        return f"{j:{sign}.4f}" if scale >= 0.01 else f"{j:{sign}.3e}"

    # Less than a millionth of the whole is rounding, not a cause.
    causes = [
        Message("{joules} {cause}", joules=joules(j, "+"), cause=cause_in_words(cause))
        for cause, j in energy.by_cause_j.items()
        if abs(j) > 1e-6 * scale
    ]
    sum_up = Message(
        "{initial} → {final} J",
        initial=joules(energy.start_j),
        final=joules(energy.end_j),
    )
    words = joined(": ", [sum_up, joined(", ", causes)]) if causes else sum_up
    return [_titled(Message("Energy"), words)]


def _explained(analysis: DropAnalysis) -> Message:
    explained = analysis.explained
    kinds = kinds_of_samples(analysis.segments)
    if explained.why is None:
        return Message("all {of:,} samples, step by step: {kinds}", of=explained.of, kinds=kinds)
    return Message(
        "{samples:,} of {of:,} samples, step by step: {kinds}; {why}",
        samples=explained.samples,
        of=explained.of,
        kinds=kinds,
        why=explained.why,
    )


_TITLE = 12
"""Width of a title in characters."""
_MOST_BOUNCES = 3
MOST_FINDINGS = 2
"""Most findings listed without --verbose."""

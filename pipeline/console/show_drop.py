"""Tell the story of one drop: what was recorded, what it tells, what was rendered."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from pipeline.console.output import (
    beside,
    counted,
    finding,
    listed,
    made,
    millimetres,
    note,
    print_json,
    print_lines,
    titled,
)
from pipeline.fields import LARGE, decimals, engineering, fraction
from pipeline.messages import shell_command
from pipeline.scenario import ENGINES, EXACT_INTEGRATORS

if TYPE_CHECKING:
    from pipeline.analysis.drop.results import Analysis, Bounce, Moment
    from pipeline.stages.render import Rendering
    from pipeline.stages.run import Run
    from pipeline.stages.simulate import Simulation


def show_simulation(simulation: Simulation, *, as_json: bool) -> None:
    """Print what `simulate` made."""
    if as_json:
        print_json(_simulation_json(simulation))
    else:
        print_lines(*simulation_lines(simulation))


def show_analysis(analysis: Analysis, *, as_json: bool) -> None:
    """Print what `analyze` found."""
    if analysis.partial:
        note(
            f"{analysis.recording} was never finished: this is the analysis of the "
            f"{counted(len(analysis.table), 'sample')} that it holds, unverified"
        )
    if as_json:
        print_json(analysis.as_json())
    else:
        print_lines(*analysis_lines(analysis))


def show_rendering(rendering: Rendering, *, as_json: bool) -> None:
    """Print what `render` made."""
    if as_json:
        print_json(_rendering_json(rendering))
    else:
        print_lines(*rendering_lines(rendering))


def show_run(run: Run, *, as_json: bool) -> None:
    """Print the whole story of a drop."""
    if as_json:
        print_json(
            {
                "simulate": _simulation_json(run.simulation),
                "analyze": run.analysis.as_json(),
                "render": _rendering_json(run.rendering),
            }
        )
    else:
        print_lines(*run_lines(run))


def run_lines(run: Run) -> list[str]:
    """Tell the whole story of a drop, and where it lies."""
    command = shell_command("drop", "view", run.simulation.recording)
    return [
        *analysis_lines(run.analysis),
        "",
        *simulation_lines(run.simulation),
        *rendering_lines(run.rendering),
        *made("see it move", command, column=_FILE),
    ]


def _simulation_json(simulation: Simulation) -> dict[str, Any]:
    return {
        "recording": str(simulation.recording),
        "recording_id": simulation.recording_id,
        "samples": simulation.samples,
        "frames": simulation.frames,
        "bytes": simulation.bytes,
        "wall_s": simulation.wall_s,
    }


def _rendering_json(rendering: Rendering) -> dict[str, Any]:
    return {
        "gif": None if rendering.gif is None else str(rendering.gif),
        "frames": rendering.frames,
        "fps": rendering.fps,
        "plot": None if rendering.plot is None else str(rendering.plot),
    }


def simulation_lines(simulation: Simulation) -> list[str]:
    """Say what was recorded."""
    facts = (
        f"{counted(simulation.samples, 'sample')}, {counted(simulation.frames, 'frame')}, "
        f"{simulation.bytes / 1e3:,.0f} kB, {simulation.wall_s:.1f} s"
    )
    return made("recording", simulation.recording, facts, column=_FILE)


def rendering_lines(rendering: Rendering) -> list[str]:
    """Say what was rendered, and how it plays."""
    lines = []
    if rendering.gif is not None:
        facts = f"{counted(rendering.frames, 'frame')}, {rendering.frames / rendering.fps:.2f} s"
        if rendering.speed is not None:
            facts += f", {_speed(rendering.speed)}"
        lines += made(rendering.gif.suffix[1:], rendering.gif, facts, column=_FILE)
    if rendering.plot is not None:
        lines += made("plot", rendering.plot, column=_FILE)
    return lines


def _speed(speed: float) -> str:
    """Return a speed in words: real time, or what part or multiple of it."""
    if abs(speed - 1) < 5e-4:
        return "in real time"
    return f"{1 / speed:.4g} times slower" if speed < 1 else f"{speed:.4g} times faster"


def analysis_lines(analysis: Analysis) -> list[str]:
    """Tell a drop from its release to its rest, in lines of at most 80 characters."""
    scenario = analysis.scenario
    first, last = analysis.table.row(0, named=True), analysis.table.row(-1, named=True)
    given, damping = scenario["linear_damping"], ""
    if given is not None or scenario["engine"] == "bullet":
        damping = f", damping {'default' if given is None else f'{given:g}'}"
    body = escape(Path(scenario["body"]).name)
    dropped = (
        f"{body} dropped{_engine(scenario)} from {decimals(first['simulated_m'], 4)} m, "
        f"timestep {fraction(scenario['timestep_s'])} s{damping}"
    )
    headline, *others = beside("", dropped, 0)
    lines = [
        headline.replace(body, f"[bold]{body}[/]", 1),
        *others,
        f"after {last['time_s']:.4g} s its centre is at {decimals(last['simulated_m'], 4)} m",
    ]
    for moment in analysis.at:
        lines += ["", *_moment(moment, scenario)]
    coverage = analysis.coverage
    if coverage.samples < coverage.of:
        covered = {0: "no sample", 1: "sample 0"}.get(
            coverage.samples, f"samples 0 to {coverage.samples - 1}"
        )
        lines += ["", *_titled("Covered", f"{covered} of {coverage.of:,}: {coverage.why}")]
    lines += ["", *_impact(analysis), *_bounces(analysis), *_rest(analysis), *_energy(analysis)]
    lines += ["", *_explained(analysis), *_flights(analysis), *_contacts(analysis)]
    if analysis.findings:
        lines.append("")
    for one in analysis.findings:
        lines += finding(one.code, one.message, column=_TITLE)
    return lines


def _titled(title: str, words: str) -> list[str]:
    return titled(title, words, column=_TITLE, style="bold")


def _engine(scenario: dict[str, Any]) -> str:
    """Say which engine dropped the body, and how it steps; nothing of PyBullet."""
    if scenario["engine"] == "bullet":
        return ""
    integrator = f" ({scenario['integrator']})" if scenario["integrator"] else ""
    return f" in {ENGINES[scenario['engine']]}{integrator}"


def _moment(moment: Moment, scenario: dict[str, Any]) -> list[str]:
    lines = [
        f"[bold]At {moment.time_s:.4g} s[/] (step {moment.step})",
        f"  simulated      {decimals(moment.simulated_m, 4):>10} m",
        f"  free fall      {decimals(moment.free_fall_m, 4):>10} m",
        f"  difference     {decimals(moment.error_m, 4, '+'):>10} m",
    ]
    terms = moment.terms_m
    if terms is None:
        return [*lines, "  not broken down: the law of free flight does not cover it"]
    drag = "drag"
    if scenario["linear_damping"] is None and terms.damping:
        drag = "Bullet's default drag"
    engine = ENGINES[scenario["engine"]]
    why = {
        "timestep": "Euler moves with the end-of-step velocity"
        if scenario["integrator"] not in EXACT_INTEGRATORS
        else "none: the integrator is exact where only gravity acts",
        "damping": f"{drag}; independent of timestep"
        if scenario["engine"] == "bullet" or scenario["linear_damping"]
        else f"none: {engine} does not damp by itself",
        "interaction": "timestep × damping",
        "rounding": "single precision" if scenario["engine"] == "physx" else "double precision",
    }
    return [
        *lines,
        "",
        *(
            line
            for name, reason in why.items()
            for line in _term(name, getattr(terms, name), reason)
        ),
        f"  {'':<12} {'─' * 13}",
        f"  {'total':<12} [bold]{millimetres(moment.error_m)}[/]",
    ]


def _term(name: str, value_m: float, reason: str) -> list[str]:
    head = f"  {name:<12} {millimetres(value_m)}"
    lines = beside(head, reason, len(head) + 3)
    return [f"{line[: len(head) + 3]}[dim]{line[len(head) + 3 :]}[/]" for line in lines]


def _impact(analysis: Analysis) -> list[str]:
    impact, landing = analysis.impact, analysis.landing
    if impact is None:
        end_s = analysis.table["time_s"][-1]
        words = f"none in {end_s:.4g} s"
        if "contact" in analysis.table["phase"]:
            words = "not known when: of several substeps PyBullet reports the last one's contact"
        inside_m = (analysis.engine.rest_height_m or 0.0) - analysis.table["simulated_m"][-1]
        if landing is not None and inside_m > 0:
            words += f", and {decimals(inside_m * 1e3, 1)} mm inside the floor at the end"
        if landing is not None:
            words += f"; {_times(None, landing.time_free_fall_s, landing.time_damped_s)}"
        return _titled("Impact", words)
    predicted = _times(impact.time_simulated_s, impact.time_free_fall_s, impact.time_damped_s)
    step_mm = impact.speed_m_s * analysis.scenario["timestep_s"] * 1e3
    step_mm /= analysis.scenario["substeps"] or 1
    depth = ""
    if impact.penetration_m is not None:
        depth = f", {decimals(impact.penetration_m * 1e3, 1)} mm deep"
        if impact.lowest_step > impact.step:
            depth += f" at most (step {impact.lowest_step})"
    return [
        *_titled("Impact", predicted or "theory does not say when: it is turned, or did not fall"),
        *_titled(
            "",
            f"arrives at {decimals(impact.speed_m_s, 3)} m/s, {decimals(step_mm, 1)} mm a step; "
            f"first contact at step {impact.step}{depth}",
        ),
    ]


def _times(simulated_s: float | None, free_s: float | None, damped_s: float | None) -> str:
    times = {"simulated": simulated_s, "free fall": free_s, "damped fall": damped_s}
    return ", ".join(f"{name} {time:.4f} s" for name, time in times.items() if time is not None)


def _bounces(analysis: Analysis) -> list[str]:
    explained = [bounce for bounce in analysis.bounces if bounce.effective_restitution is not None]
    lines = []
    if analysis.impact and analysis.engine.pair_restitution and (analysis.engine.substeps or 1) > 1:
        lines = _titled(
            "Bounces", "not counted: of substeps PyBullet reports only the last contact"
        )
    for number, bounce in enumerate(explained[:_MOST_BOUNCES], start=1):
        lines += _titled(f"Bounce {number}", _bounce(analysis, bounce))
    left = len(explained) - _MOST_BOUNCES
    if left > 0:
        lines += _titled("", f"and {left} more bounce{'s' * (left > 1)}: see --json")
    if analysis.tumbled_step is not None:
        time_s = analysis.table["time_s"][analysis.tumbled_step]
        words = f"from t = {time_s:.4g} s (step {analysis.tumbled_step}) on: "
        words += "measured, not predicted"
        tumbling = len(analysis.bounces) - len(explained)
        if tumbling:
            highest_mm = max(bounce.apex_m for bounce in analysis.bounces[len(explained) :]) * 1e3
            words += (
                f"; {tumbling} more bounce{'s' * (tumbling > 1)}, up to "
                f"{decimals(highest_mm, 1)} mm"
            )
        lines += _titled("Tumbles" if analysis.tumbles else "Not flat", words)
    return lines


def _bounce(analysis: Analysis, bounce: Bounce) -> str:
    said = f"rises {_positive_mm(bounce.apex_m)} mm"
    if bounce.predicted_apex_m is None:
        said += " in this recording"
    body, floor = analysis.engine.restitution, analysis.engine.floor_restitution
    if bounce.predicted_apex_m is not None and body is not None and floor is not None:
        pair = analysis.engine.combined_restitution
        asked = f"{body * floor:.4g} ({body:g} × {floor:g})" if pair is None else f"{pair:.4g}"
        said += f"; a restitution of {asked} alone gives {_positive_mm(bounce.predicted_apex_m)} mm"
    said += f". Effective restitution {bounce.effective_restitution:.4f}"
    if bounce.correction_m_s is not None and abs(bounce.correction_m_s) >= 5e-4:
        said += f": the position correction changes the rebound by {bounce.correction_m_s:+.3f} m/s"
    if bounce.uncorrected_apex_m is not None and analysis.scenario["contact_erp"] != 0:
        rises = f"{_positive_mm(bounce.uncorrected_apex_m)} mm"
        said += f"; with --contact-erp 0 --solver-residual 0 it rises {rises}"
    return said


def _positive_mm(length_m: float) -> str:
    """Write a length in millimetres; what rounds to nothing has no sign."""
    return decimals(round(length_m * 1e3, 1) + 0.0, 1)


def _rest(analysis: Analysis) -> list[str]:
    rest = analysis.rest
    if rest is None:
        return []
    lines = _titled(
        "Rest",
        f"{decimals(rest.height_m, 4)} m: the position is the body's centre, not its underside",
    )
    if rest.settled_step is None:
        lines += _titled("", "it goes on creeping or turning to the end of the recording")
    if rest.expected_m is None or rest.error_m is None:
        return lines + _titled("", "nothing says how high a body lies that is turned like this")
    error = f"{decimals(rest.error_m * 1e6, 2, '+')} µm off {rest.expected_m:g} m"
    if rest.sinks_m is not None:
        depth = decimals(rest.sinks_m * 1e6, 2)
        by = "MuJoCo's soft contact (solref, solimp)"
        if analysis.engine.modulus_pa is not None:
            by = f"Drake's compliant contact (modulus {analysis.engine.modulus_pa:.0e} Pa)"
        sinks = f"{by} carries it at a depth of {depth} µm"
        return lines + _titled("", f"{error}: {sinks}")
    if rest.terms_m is None:
        return lines + _titled("", f"{error}; the contact law does not cover this landing")
    terms = rest.terms_m
    return lines + _titled(
        "",
        f"{error}: {_micrometres(terms.slop)} slop, {_micrometres(terms.solver)} solver stopped "
        f"early, {_micrometres(terms.settling)} not yet settled",
    )


def _micrometres(length_m: float) -> str:
    return decimals(round(length_m * 1e6, 2) + 0.0, 2, "+")


def _energy(analysis: Analysis) -> list[str]:
    energy = analysis.energy
    lost = {
        "damping": energy.damping_j,
        "integrator": energy.integrator_j,
        "velocity limit": energy.clamp_j,
        "rotation": energy.rotation_j,
        "angular damping in contact": energy.spin_damping_j,
        "contact": energy.contact_j,
    }
    scale = max(abs(energy.initial_j), abs(energy.final_j))

    def joules(j: float, sign: str = "") -> str:
        if scale >= LARGE:
            return engineering(j, sign)
        return f"{j:{sign}.4f}" if scale >= 0.01 else f"{j:{sign}.3e}"

    # What is a millionth of the whole is rounding, and no cause.
    causes = [
        f"{joules(j, '+')} {cause}" for cause, j in lost.items() if j and abs(j) > 1e-6 * scale
    ]
    sum_up = f"{joules(energy.initial_j)} J at release, {joules(energy.final_j)} J at the end"
    return _titled("Energy", f"{sum_up}: {', '.join(causes)}" if causes else sum_up)


def _explained(analysis: Analysis) -> list[str]:
    explained, counts = analysis.explained, asdict(analysis.segments)
    kinds = ", ".join(f"{count:,} {name}" for name, count in counts.items() if count)
    if explained.why is None:
        return _titled("Explained", f"all {explained.of:,} samples, step by step: {kinds}")
    words = f"{explained.samples:,} of {explained.of:,} samples, step by step: {kinds}; "
    return _titled("Explained", words + explained.why)


def _flights(analysis: Analysis) -> list[str]:
    """Return a table of what each flight is off free fall at its end, from its first sample on."""
    rows = [
        (
            f"{flight.start_s:7.4f} s {flight.end_s:7.4f} s  ",
            " ".join(f"{round(length_m * 1e3, 4) + 0.0:+9.4f} mm" for length_m in flight.error_m),
        )
        for flight in analysis.flights[:_MOST_FLIGHTS]
    ]
    header = (f"{'from':>9} {'to':>9}   ", f"{'x off':>12} {'y off':>12} {'z off':>12}")
    return _listed("Flights", header, rows, len(analysis.flights), "flight")


def _contacts(analysis: Analysis) -> list[str]:
    """Return a table of what each contact gave to the body."""
    phases, dt = analysis.contact_phases, analysis.scenario["timestep_s"]
    rows = [
        (
            f"{phase.first_step * dt:7.4f} s {phase.last_step * dt:7.4f} s  ",
            f"{math.hypot(*phase.impulse_n_s):9.4g} Ns {phase.largest_force_n:10.4g} N "
            f"{phase.kinetic_j + 0.0:+10.3g} J",
        )
        for phase in phases[:_MOST_FLIGHTS]
    ]
    header = (f"{'from':>9} {'to':>9}   ", f"{'impulse':>12} {'largest':>12} {'kinetic':>12}")
    return _listed("Contacts", header, rows, len(phases), "contact")


def _listed(
    title: str, header: tuple[str, str], rows: list[tuple[str, str]], count: int, name: str
) -> list[str]:
    if not rows:
        return []
    lines, more = listed(title, [header, *rows], column=_TITLE), count - len(rows)
    return [*lines, f"{'':{_TITLE}}and {counted(more, f'more {name}')}"] if more else lines


_TITLE = 12
"""Columns that a title takes."""
_FILE = 17
_MOST_BOUNCES = 5
_MOST_FLIGHTS = 5

"""The analysis in words, for the layer: what happened when, and where the error comes from.

It is recorded, and so always in English.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict

from pipeline.analysis.drop.results import Analysis, Finding, Moment
from pipeline.analysis.script.results import ScriptFinding
from pipeline.fields import decimals


def events(analysis: Analysis) -> list[tuple[int, str]]:
    """Return what happened, as steps and lines: release, error breakdowns, impact, rest."""
    height_m = analysis.table["simulated_m"][0]
    lines = [(0, f"release at {height_m:g} m")]
    lines += [(moment.step, _sum(moment)) for moment in analysis.at]
    impact, rest = analysis.impact, analysis.rest
    if impact is not None:
        # `impact.step` is the first sample that the contact has acted on; the body is in the floor,
        # and perhaps deepest, a step earlier.
        touches = min(impact.step, impact.lowest_step)
        lines.append((touches, f"first contact, arriving at {impact.speed_m_s:.3f} m/s"))
    if analysis.tumbled_step is not None:
        lines.append((analysis.tumbled_step, "tumbles from here on"))
    if impact is not None and impact.penetration_m is not None:
        depth_mm = impact.penetration_m * 1e3
        lines.append((impact.lowest_step, f"lowest point, {depth_mm:.3f} mm in the floor"))
    lines += [
        (bounce.step, f"rebound at {bounce.rebound_m_s:.3f} m/s") for bounce in analysis.bounces
    ]
    if rest is not None and rest.settled_step is not None:
        lines.append((rest.settled_step, f"at rest at {rest.height_m * 1e3:.3f} mm"))
    return sorted(lines, key=lambda event: event[0])


def _sum(moment: Moment) -> str:
    """Write an error as a sum on one line; terms that round to zero are left out."""
    terms = moment.terms_m
    total = f"{decimals(moment.error_m * 1e3, 2, '+')} mm off"
    if terms is None:
        return total
    parts = [
        f"{name} {value_m * 1e3:+.2f}"
        for name, value_m in asdict(terms).items()
        if abs(value_m) > 5e-6
    ]
    return f"{total}: {', '.join(parts)}" if parts else total


def _millimetres(value_m: float) -> str:
    """Write a length in mm; in powers of ten where four decimals would show zero."""
    value = value_m * 1e3 + 0.0
    return f"{value:+.4f}" if value == 0 or abs(value) >= 5e-5 else f"{value:+.1e}"


def findings_markdown(analysis: Analysis) -> str:
    """Return the analysis as Markdown."""
    return "\n".join([*_moments(analysis), *findings_listed(analysis.findings)])


def _moments(analysis: Analysis) -> Iterator[str]:
    for moment in analysis.at:
        if moment.terms_m is None:
            continue
        yield f"## At {moment.time_s:.4g} s"
        yield ""
        yield "| | mm |"
        yield "| --- | --- |"
        for name, value_m in asdict(moment.terms_m).items():
            yield f"| {name} | {_millimetres(value_m)} |"
        yield f"| **simulated − free fall** | **{_millimetres(moment.error_m)}** |"
        yield ""


def findings_listed(findings: Sequence[Finding | ScriptFinding]) -> Iterator[str]:
    """Yield the lines of the chapter on findings."""
    yield "## Findings"
    yield ""
    if not findings:
        yield "None: nothing in this recording needs a second look."
    for finding in findings:
        yield f"- **{finding.code}**: {finding.message}"
        yield ""

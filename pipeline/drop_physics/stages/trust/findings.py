"""Describes in sentences what the variations of a script have changed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from drop_physics.experiments.robustness import Converging, Growth
from drop_physics.messages import Message
from drop_physics.rules.answer import Finding

if TYPE_CHECKING:
    from drop_physics.stages.trust.runs import Made, Varied

TERMS = {
    "gravity": Message("gravity"), "bias": Message("Coriolis and gyroscopic forces"),
    "damping": Message("damping"), "joint damping": Message("joint damping"),
    "applied": Message("the script's forces and torques"), "motors": Message("motors"),
    "contacts": Message("contacts"), "rolling": Message("rolling friction"),
    "constraints": Message("constraints"), "stops": Message("joint limits"),
    "clamp": Message("the velocity limit"), "integrator": Message("integration"),
    "set": Message("the script's calls"),
}  # fmt: skip
BY_STEP = {
    "motors": Message(
        "position and velocity motors close a share of the gap per step, not per second"
    ),
    "contacts": Message(
        "contacts begin at a step, and push overlap out by a share per step, not per second"
    ),
    "constraints": Message("constraints close a share of the gap per step, not per second"),
    "integrator": Message(
        "a step moves with the velocity that it ends with: that is off by half a step's change"
    ),
}
"""Reasons why a term depends on the timestep."""
SMALL = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def readable(value: float, unit: str) -> str:
    """Format a distance with three digits: 3.12 mm, 0.00123 rad."""
    if not math.isfinite(value):
        return Message("no number")
    if not value:
        return f"0 {unit}"
    if unit != "m":
        return f"{value:.3g} {unit}"
    size, prefix = next((each for each in SMALL if value >= each[0] * 0.9995), SMALL[-1])
    number = f"{value / size:.3g}"
    return f"{float(number):g} {prefix}m"


def part_of(body: str, joint: str | None, unit: str = "m") -> str:
    """Return the display name of a position: the body's, or a joint's."""
    if joint is not None:
        return f"{body} {joint}"
    return body if unit == "m" else Message("{body}, orientation", body=body)


def findings_of(
    varied: Sequence[Varied], grown: Growth | None, found: list[Converging], base: Made
) -> list[Finding]:
    """Return sentences about the variations as findings, most severe first."""
    grows = [] if grown is None else [_grows(grown)]
    return sorted([*_ending(varied, base), *grows, *_converges(found)], key=lambda each: each.rank)


def _ending(varied: Sequence[Varied], base: Made) -> Iterator[Finding]:
    """Yield a finding for variations that fail, or end differently from the script itself."""
    for each in varied:
        if each.made.ended == "failed" != base.ended:
            yield Finding(
                code="variation-failed",
                level="broken",
                message=Message(
                    "with {name} the script fails: {error}", name=each.name, error=each.made.error
                ),
            )
        elif each.made.steps > base.steps:
            yield Finding(
                code="goes-on",
                level="model",
                message=Message(
                    "with {name} the script goes on after its {all} steps; only these are compared",
                    name=each.name,
                    all=base.steps,
                ),
            )
        elif each.made.steps < base.steps:
            yield Finding(
                code="ends-earlier",
                level="model",
                message=Message(
                    "with {name} the script ends after {steps} of {all} steps",
                    name=each.name,
                    steps=each.made.steps,
                    all=base.steps,
                ),
            )


def _grows(grown: Growth) -> Finding:
    if grown.rate_per_s is not None:
        message = Message(
            "a displacement of {start} grows e-fold in {time:.3g} s",
            start=readable(grown.start, "m"),
            time=1 / grown.rate_per_s,
        )
    else:
        message = Message(
            "a displacement of {start} grows to {most}",
            start=readable(grown.start, "m"),
            most=readable(grown.most, grown.unit),
        )
    if grown.lost_s is None:
        return Finding(code="grows", level="note", message=message)
    lost = Message(
        "{grows}: beyond {time:.3g} s the outcome is one of many", grows=message, time=grown.lost_s
    )
    return Finding(code="one-of-many", level="repeat", message=lost)


def _converges(found: list[Converging]) -> Iterator[Finding]:
    for each in found:
        part = part_of(each.body, each.joint) + (f" {each.axis}" if each.axis else "")
        coarse, middle, fine = each.ends
        if each.order is None:
            shrinks = abs(fine - middle) < abs(middle - coarse)
            said = (
                Message(
                    "{part} shows no order of convergence with the timestep",
                    part=part,
                )
                if shrinks
                else Message("{part} does not converge with the timestep", part=part)
            )
            yield Finding(
                code="no-order" if shrinks else "does-not-converge",
                level="model",
                message=Message(
                    "{said}: it ends at {coarse:.9g}, {middle:.9g} and {fine:.9g} {unit}",
                    said=said,
                    coarse=coarse,
                    middle=middle,
                    fine=fine,
                    unit=each.unit,
                ),
                body=each.body,
                joint=each.joint,
            )
        else:
            yield Finding(
                code="converges",
                level="note",
                message=Message(
                    "{part} converges with the timestep at order {order:.2f} to {value} ± {off} "
                    "{unit}",
                    part=part,
                    order=each.order,
                    unit=each.unit,
                    value=f"{each.extrapolated:.7g}",
                    off=f"{each.uncertainty:.1g}",
                ),
                body=each.body,
                joint=each.joint,
            )

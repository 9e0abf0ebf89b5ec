"""The plot of a drop: the fall compared with theory, where it applies, and the error's terms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from drop_physics import colours
from drop_physics.drop.results import FallAnalysis
from drop_physics.fields import fraction
from drop_physics.figures.plot import Curve, Inset, Panel, Plot
from drop_physics.messages import Message, joined
from drop_physics.scenario import Scenario
from drop_physics.sweeping.plan import label_of

BEFORE, AFTER = 4, 10
"""Number of steps before and after an impact that the inset enlarges."""
FREE = 0.55, 0.3
"""The inset covers no curve if, from the first share of the time on, the drop stays below the
second share of its height."""
NOTHING_MM = 1e-9
"""Errors below this size [mm] are rounding, and get no panel."""


def plot_of_drop(analysis: FallAnalysis) -> Plot:
    """Return the plot of a drop."""
    table, timestep_s = analysis.table, analysis.scenario["timestep_s"]
    times_s, simulated_m = table["time_s"].to_numpy(), table["simulated_m"].to_numpy()
    covered = table["timestep_m"].is_not_null().to_numpy()
    curves = [Curve(Message("simulated"), times_s, simulated_m, colours.SIMULATED)]
    panels = [
        Panel(
            Message("height of the centre"),
            "m",
            curves,
            zero=bool(simulated_m.min() >= 0),
            inset=_impact(analysis, timestep_s),
        )
    ]
    if covered.any():
        free_m, damped_m = (
            np.where(covered, table[name].to_numpy(), np.nan)
            for name in ("free_fall_m", "damped_fall_m")
        )
        curves.insert(0, Curve(Message("free fall"), times_s, free_m, colours.FREE_FALL, "wide"))
        curves.insert(
            1, Curve(Message("damped fall"), times_s, damped_m, colours.DAMPED_FALL, "broad")
        )
        errors_mm = {
            name: 1e3 * table[f"{name}_m"].fill_null(np.nan).to_numpy() for name in colours.TERMS
        }
        total = Curve(Message("total"), times_s, np.sum([*errors_mm.values()], axis=0), "")
        if max(np.nanmax(np.abs(each)) for each in errors_mm.values()) > NOTHING_MM:
            panels.append(
                Panel(
                    Message("simulated − free fall"),
                    "mm",
                    [
                        total,
                        *(
                            Curve(Message(name), times_s, values, colours.TERMS[name])
                            for name, values in errors_mm.items()
                        ),
                    ],
                    zero=True,
                    stacked=True,
                )
            )
    return Plot(_dropped(analysis), [*_said_of_drop(analysis, timestep_s)], panels)


def _impact(analysis: FallAnalysis, timestep_s: float) -> Inset | None:
    """Return an inset with the steps around the impact; None if it would cover curves."""
    impact, heights_m = analysis.impact, analysis.table["simulated_m"].to_numpy()
    if impact is None or impact.time_simulated_s is None or impact.step is None:
        return None
    later_m = heights_m[int(FREE[0] * len(heights_m)) :]
    if later_m.max() > FREE[1] * heights_m.max():
        return None
    first, last = impact.step - BEFORE - 0.5, impact.step + AFTER + 0.5
    return Inset(Message("impact, enlarged"), first * timestep_s, last * timestep_s)


def _dropped(analysis: FallAnalysis) -> Message:
    scenario = analysis.scenario
    values = {"body": scenario["body"], "height": scenario["height_m"]}
    if any(scenario["velocity_m_s"]):
        return Message("{body} thrown from {height:g} m", **values)
    return Message("{body} dropped from {height:g} m", **values)


def _said_of_drop(analysis: FallAnalysis, timestep_s: float) -> Iterator[Message]:
    """Yield sentences on non-default settings, one breakdown of the error, and the drop's end."""
    standard, own = asdict(Scenario()), analysis.scenario
    shown = {"linear_damping": own["linear_damping"]}
    shown |= {name: value for name, value in own.items() if value != standard[name]}
    for name in ("body", "height_m", "timestep_s", "duration_s"):  # shown elsewhere, or on the axis
        shown.pop(name, None)
    yield Message(
        "timestep {timestep} s, {settings}", timestep=fraction(timestep_s), settings=label_of(shown)
    )
    for moment in analysis.at[:1]:
        if moment.terms_m is not None:
            terms = [
                Message("{name} {value:+.3f}", name=Message(name), value=1e3 * value_m)
                for name, value_m in asdict(moment.terms_m).items()
                if abs(value_m) > 5e-7
            ]
            yield Message(
                "at {time:.4g} s {total:+.3f} mm: {terms}",
                time=moment.time_s,
                total=1e3 * moment.error_m,
                terms=joined(", ", terms),
            )
    ends = []
    if analysis.impact is not None and analysis.impact.time_simulated_s is not None:
        ends.append(Message("impact at {at:.4g} s", at=analysis.impact.time_simulated_s))
    if analysis.rest is not None:
        ends.append(Message("rests at {height:.3f} mm", height=1e3 * analysis.rest.height_m))
    if ends:
        yield joined(", ", ends)

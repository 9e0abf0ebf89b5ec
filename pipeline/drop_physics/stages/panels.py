"""What a plot tells: of a script the verdict and the panels that show it, of a drop its error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics import colours
from drop_physics.analysis.results import Analysis, BodyAnalysis
from drop_physics.drop.results import FallAnalysis
from drop_physics.explain.curves import FORCES, Curves
from drop_physics.explain.joints import JointRow
from drop_physics.fields import fraction
from drop_physics.figures.plot import Curve, Inset, Look, Panel, Plot
from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Finding
from drop_physics.scenario import Scenario
from drop_physics.sweeping.plan import label_of
from drop_physics.trace.events import Body

Float64 = NDArray[np.float64]

MOST_PANELS, MOST_CAUSES = 4, 4
BEFORE, AFTER = 4, 10
"""Steps before and after an impact that are drawn enlarged."""
FREE = 0.55, 0.3
"""Share of the time, and of the height below which a drop stays from then on, to leave room."""
NOTHING_MM = 1e-9
"""Errors of a drop below this are rounding, and have no panel."""
NAMES = {
    "contacts": Message("contact"),
    "rolling": Message("rolling friction"),
    "clamp": Message("velocity limit"),
}
"""What is said of causes whose name says less."""
OF_FILES = ("no-inertial", "inertia-from-shape", "impossible-inertia", "inertia-without-mass")
"""Findings that no curve of a joint shows."""
NOISY, JUMPS, WINDOWS = 0.4, 0.05, 60
"""A torque that turns around in more than this share of its samples, and jumps by more than this
share of its range, is evened over this part of the time."""
LEAST_SHARE = 0.02
"""Causes that gave less of what was given are left out."""
FLIES = 0.1
"""A body flies if a flight is at least this share of its samples."""
WHOLE = 0.9
"""A finding that covers more of the time than this is not marked."""
MOST_JOINTS, MOST_BODIES = 4, 3
"""Joints, and bodies whose energy is shown, in the viewer."""
JOINT = 24
"""Characters of a joint's name that fit in the viewer's legends."""
NEAR = 0.02
"""A joint that came closer to a limit, as a share of its range, is shown with it."""
FAR, REACHED = 3.0, 1.05
"""A limit over so many times the largest torque is not drawn; of joints side by side, so many."""


def plot_of(analysis: Analysis | FallAnalysis) -> Plot:
    """Return what the plot of a recording tells."""
    if isinstance(analysis, FallAnalysis):
        return _plot_of_drop(analysis)
    title, *lines = _verdict(analysis)
    return Plot(title, lines, [*_panels(analysis)][:MOST_PANELS])


def _verdict(analysis: Analysis) -> Iterator[str]:
    explained, script = analysis.explained, str((analysis.origin or {}).get("script") or "")
    if not analysis.findings:
        yield Message("{script}: nothing needs a second look", script=script)
    for finding in analysis.findings[:1]:
        first, _, rest = finding.said.partition(": ")
        if first == finding.body:
            more, _, rest = rest.partition(": ")
            first = f"{first}: {more}"
        yield first
        if rest:
            yield rest
        if finding.advice:
            yield finding.advice
    yield Message(
        "{script}: {explained:,} of {of:,} samples explained, findings: {findings}",
        script=script,
        explained=explained.samples,
        of=explained.of,
        findings=len(analysis.findings),
    )


# -- of a drop ------------------------------------------------------------------------------------


def _plot_of_drop(analysis: FallAnalysis) -> Plot:
    """Return the fall beside theory, as far as that goes, and the terms of its error."""
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
    """Return the steps around the impact; None where that would hide what comes later."""
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
    """Yield what is not the default, one moment of the error, and how the fall ends."""
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


# -- of a script ----------------------------------------------------------------------------------


def viewed(analysis: Analysis, bodies: Mapping[int, Body]) -> tuple[list[Panel], list[str]]:
    """Return the panels of the viewer (joints, friction, flights, energy), and which bodies matter.

    These are labels, in order.
    """
    told = _Told(analysis)
    panels = [*told.driven(bodies)]
    for finding in analysis.findings:
        if finding.joint is None:
            panels += told.of(finding, "")
    for body in told.about[:MOST_BODIES]:
        panels += told.energy(body)
    return panels, [body.label for body in told.about]


# -- which panels ---------------------------------------------------------------------------------


def _panels(analysis: Analysis) -> Iterator[Panel]:
    """Yield what the findings are about, the gravest first, then energy and flights."""
    told = _Told(analysis)
    for number, finding in enumerate(analysis.findings, 1):
        yield from told.of(finding, str(number))
    yield from told.rest()


class _Told:
    """Makes each kind of panel once."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        assert analysis.curves is not None  # of a script
        self._curves = analysis.curves
        self._bodies = {body.label: body for body in analysis.bodies}
        self._done: set[str] = set()
        found = [self._bodies[each.body] for each in analysis.findings if each.body in self._bodies]
        moves = {
            body.label: sum(body.segments.values()) - body.segments["still"]
            for body in analysis.bodies
        }
        moving = sorted(analysis.bodies, key=lambda body: -moves[body.label])
        moving = [body for body in moving if moves[body.label]]
        self.about = [*{body.label: body for body in (*found, *moving)}.values()]
        """The bodies that findings are about, the gravest first, and those that move."""

    def of(self, finding: Finding, mark: str) -> Iterator[Panel]:
        """Yield the panels that show what a finding says."""
        body = self._bodies.get(finding.body or "")
        if body is None:
            return
        panels: list[Panel] = []
        if finding.joint and finding.code not in OF_FILES and self._is_new("joint"):
            row = next((row for row in body.joints if row.name == finding.joint), None)
            panels = [] if row is None else [*self._joint(body, row)]
        elif finding.other in self._bodies and self._is_new("friction"):
            panels = [*self._friction(body, self._bodies[finding.other])]
        elif _flies(body) and self._is_new("heights"):
            panels = [*self._heights(body)]
        for panel in panels:
            yield replace(panel, mark=mark, span_s=self._span_s(finding, body))

    def rest(self) -> Iterator[Panel]:
        """Yield what is worth a look in any case, of the body that the findings are about."""
        for body in self.about:
            rows = [row for row in body.joints if row.off is not None]
            if rows and self._is_new("joint"):
                yield from self._joint(body, max(rows, key=lambda row: abs(row.off or 0.0)))
            if _flies(body) and self._is_new("heights"):
                yield from self._heights(body)
            if body.energy is not None and "energy" not in self._done:
                panels = [*self.energy(body)]
                self._done |= {"energy"} if panels else set()
                yield from panels

    def _is_new(self, kind: str) -> bool:
        new = kind not in self._done
        self._done.add(kind)
        return new

    # -- joints side by side, for the viewer ------------------------------------------------------

    def driven(self, bodies: Mapping[int, Body]) -> Iterator[Panel]:
        """Yield positions, rates, torques of joints with findings, or farthest off their targets.

        At most `MOST_JOINTS` of all bodies.
        """
        named = [
            (each.body, each.joint) for each in self._analysis.findings if each.code not in OF_FILES
        ]
        found = [
            (
                named.index((body.label, row.name))
                if (body.label, row.name) in named
                else len(named),
                -abs(row.off or 0.0),
                body,
                place,
            )
            for body in self.about
            for place, row in enumerate(body.joints)
        ]
        shown = sorted(found, key=lambda each: each[:2])[:MOST_JOINTS]
        several = len({body.id for *_, body, _ in shown}) > 1
        lines: dict[str, list[Curve]] = {"position": [], "rate": [], "torque": []}
        units: dict[str, dict[str, None]] = {what: {} for what in lines}
        for (*_, body, place), colour in zip(shown, colours.JOINTS, strict=False):
            curves, row = self._curves.joints(body.id), body.joints[place]
            if curves is None:
                continue
            its = Curves(
                curves.steps, {what: each[:, place] for what, each in curves.columns.items()}
            )
            name = row.name if len(row.name) <= JOINT else f"{row.name[: JOINT - 1]}…"
            name = f"{body.id} {name}" if several else name
            what = "rate" if row.control == "velocity" else "position"
            kinds = {what: ["target" if what == "position" else "target_rate"], "torque": []}
            if what == "position":
                kinds[what] += _stops(its, bodies[body.id], row)
            kinds["torque"] += _limits(its, REACHED)
            for which, others in kinds.items():
                lines[which].append(self._curve(body, its, which, name, colour))
                # Under the same name, which the viewer lists once.
                lines[which] += [
                    self._curve(body, its, each, name, colour, dashed=True)
                    for each in others
                    if np.isfinite(its.columns[each]).any()
                ]
            units[what][row.unit] = None
            units["torque"][row.torque_unit] = None
        titles = {
            "position": "Joint positions, thin: targets and stops",
            "rate": "Joint rates, thin: targets",
            "torque": "Motors, thin: limits",
        }
        for what, title in titles.items():
            if lines[what]:
                yield Panel(title, ", ".join(units[what]), lines[what])

    # -- what is in them --------------------------------------------------------------------------

    def _joint(self, body: BodyAnalysis, row: JointRow) -> Iterator[Panel]:
        curves = self._curves.joints(body.id)
        k = body.joints.index(row)
        if curves is None:
            return
        its = Curves(curves.steps, {name: each[:, k] for name, each in curves.columns.items()})
        what = "rate" if row.control == "velocity" else "position"
        asked = {"rate": "target_rate", "position": "target"}[what]
        title = Message("{joint}: position", joint=row.name)
        if what == "rate":
            title = Message("{joint}: rate", joint=row.name)
        yield Panel(
            title,
            row.unit,
            [
                self._curve(body, its, what, Message("reached"), colours.SIMULATED),
                self._curve(body, its, asked, Message("target"), "", dashed=True),
            ],
        )
        limits = [
            self._curve(body, its, side, Message("limit"), "", dashed=True) for side in _limits(its)
        ]
        title = Message("{joint}: torque of its motor", joint=row.name)
        window = _window(its.columns["torque"])
        if window > 1:
            times_s = self._curves.times_s(body.id, its.steps[[0, window]])
            title = Message(
                "{joint}: torque of its motor, mean over {span:.2g} s",
                joint=row.name,
                span=times_s[1] - times_s[0],
            )
            padded = np.pad(its.columns["torque"], (window // 2, window - 1 - window // 2), "edge")
            its.columns["torque"] = np.convolve(padded, np.full(window, 1 / window), "valid")
        drawn = self._curve(body, its, "torque", Message("torque"), colours.ROUNDING)
        yield Panel(title, row.torque_unit, [drawn, *limits], zero=True)

    def _friction(self, body: BodyAnalysis, other: BodyAnalysis) -> Iterator[Panel]:
        its = self._curves.friction(body.id, other.id)
        if its is None or len(its.steps) < 2:
            return
        title = Message("friction between {body} and {other}", body=body.label, other=other.label)
        yield Panel(
            title,
            "N",
            [
                self._curve(
                    body, its, "available", Message("available"), colours.FREE_FALL, wide=True
                ),
                self._curve(body, its, "used", Message("used"), colours.INTERACTION),
            ],
            zero=True,
        )

    def energy(self, body: BodyAnalysis) -> Iterator[Panel]:
        """Yield what changed a body's energy."""
        its = self._curves.energy(body.id)
        if its is None:
            return
        sizes = {name: float(np.nanmax(np.abs(its.columns[name]), initial=0.0)) for name in FORCES}
        causes = sorted(FORCES, key=lambda name: -sizes[name])[:MOST_CAUSES]
        causes = [name for name in causes if sizes[name] > LEAST_SHARE * sizes[causes[0]]]
        if not causes or not its.columns["whole"].any():
            return
        title = Message("energy of {body} since the start, by cause", body=body.label)
        whole = self._curve(body, its, "whole", Message("together"), "")
        yield Panel(
            title,
            "J",
            [
                whole,
                *(
                    self._curve(body, its, name, NAMES.get(name, name), colours.CAUSES[name])
                    for name in causes
                ),
            ],
            zero=True,
        )

    def _heights(self, body: BodyAnalysis) -> Iterator[Panel]:
        rows = self._analysis.table.filter(pl.col("body") == body.id)
        times_s, z_m = rows["time_s"].to_numpy(), rows["z_m"].to_numpy()
        steps = rows["step"].to_numpy()
        fall_m = z_m - rows["error_z_m"].fill_null(np.nan).to_numpy()
        title = Message("height of {body}", body=body.label)
        yield Panel(
            title,
            "m",
            [
                Curve(Message("free fall"), times_s, fall_m, colours.FREE_FALL, "wide", steps),
                Curve(Message("simulated"), times_s, z_m, colours.SIMULATED, steps=steps),
            ],
        )

    def _curve(
        self,
        body: BodyAnalysis,
        its: Curves,
        column: str,
        name: str,
        colour: str,
        *,
        dashed: bool = False,
        wide: bool = False,
    ) -> Curve:
        steps, values = its.steps, its.columns[column]
        gaps = np.flatnonzero(np.diff(steps) > 1.5 * np.diff(steps).min(initial=len(steps))) + 1
        times_s = self._curves.times_s(body.id, steps)
        look: Look = "dashed" if dashed else "wide" if wide else "line"
        return Curve(
            name,
            np.insert(times_s, gaps, times_s[gaps]),
            np.insert(values, gaps, np.nan),
            colour,
            look,
            np.insert(steps, gaps, steps[gaps]),
        )

    def _span_s(self, finding: Finding, body: BodyAnalysis) -> tuple[float, float] | None:
        steps = finding.steps
        if steps is None or steps.last - steps.first > WHOLE * self._analysis.samples:
            return None
        ends = np.array([steps.first, steps.last])
        first_s, last_s = self._curves.times_s(body.id, ends).tolist()
        return first_s, last_s


def _window(torque: Float64) -> int:
    """Return over how many samples a torque is evened: 1 if it is smooth."""
    jumps = np.diff(torque)
    if len(torque) < 4 * WINDOWS or not np.isfinite(jumps).all():
        return 1
    turns = float((jumps[1:] * jumps[:-1] < 0).mean())
    size = float(np.abs(jumps).mean()) / (float(np.ptp(torque)) or 1.0)
    return len(torque) // WINDOWS if turns > NOISY and size > JUMPS else 1


def _limits(its: Curves, far: float = FAR) -> list[str]:
    """Return the limits that a torque comes near, of which the lower one is added."""
    torque, limit = its.columns["torque"], its.columns["limit"]
    most = float(np.nanmax(np.abs(torque), initial=0.0))
    if np.nanmin(limit, initial=np.inf) > far * most:
        return []
    its.columns["-limit"] = -limit
    sides = [("limit", torque.max() > 0.5 * most), ("-limit", torque.min() < -0.5 * most)]
    return [side for side, near in sides if near]


def _stops(its: Curves, body: Body, row: JointRow) -> list[str]:
    """Return the ends of its range that a joint comes near, which are added."""
    low, high = body.joints[row.index].limits
    at = its.columns["position"]
    its.columns.update(lowest=np.full(at.shape, low), highest=np.full(at.shape, high))
    room = NEAR * (high - low)
    near = [
        np.nanmin(at, initial=np.inf) < low + room,
        np.nanmax(at, initial=-np.inf) > high - room,
    ]
    return [
        name
        for name, is_near in zip(("lowest", "highest"), near, strict=True)
        if is_near and low < high
    ]


def _flies(body: BodyAnalysis) -> bool:
    longest = max((each.last_step - each.first_step for each in body.flights), default=0)
    return longest > FLIES * sum(body.segments.values())

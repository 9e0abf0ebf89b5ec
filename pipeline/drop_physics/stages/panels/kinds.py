"""Kinds of panels (groups of curves) about bodies: one function each, listed in `KINDS`.

Called with a finding, a kind yields panels that illustrate the finding; called with None, it yields
panels of general interest. It yields nothing if it has no curve to show. Plot, video and viewer use
the same kinds; a new kind is a new function here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from drop_physics import colours
from drop_physics.account.joints import JointRow
from drop_physics.account.rows import AccountRow
from drop_physics.analysis.results import Analysis, BodyAnalysis
from drop_physics.arrays import Float64
from drop_physics.explain.cause_names import cause_in_words
from drop_physics.explain.curves import FORCES, Curves
from drop_physics.figures.plot import Curve, Look, Panel
from drop_physics.messages import Message
from drop_physics.rules.answer import Finding
from drop_physics.trace.events import Body

MOST_CAUSES = 4
TARGETS = {"rate": "target_rate", "position": "target"}
"""Column of a motor's target, by the column of the controlled quantity."""
OF_FILES = ("no-inertial", "inertia-from-shape", "impossible-inertia", "inertia-without-mass")
"""Findings that no curve of a joint can illustrate."""
NOISY, JUMPS, WINDOWS = 0.4, 0.05, 60
"""A torque is smoothed if it reverses in more than the share NOISY of its samples, and jumps by
more than the share JUMPS of its range; the smoothing window is 1/WINDOWS of the time."""
LEAST_SHARE = 0.02
"""Smallest share of the total energy at which a cause is drawn."""
FLIES = 0.1
"""Smallest share of a body's samples in a single flight at which the body counts as flying."""
WHOLE = 0.9
"""A finding that covers more than this share of the time is not marked in the panel."""
MOST_JOINTS = 4
"""Largest number of joints side by side in the viewer."""
JOINT = 24
"""Number of characters of a joint's name that fit into the viewer's legend."""
NEAR = 0.02
"""Distance from a limit, as a share of the joint's range, below which the limit is drawn."""
FAR, REACHED = 3.0, 1.05
"""Multiple of the largest torque up to which a limit is drawn; the second is for joints side by
side."""


class Drawable:
    """The data from which panels are drawn: an analysis, its curves, and the relevant bodies."""

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        assert analysis.curves is not None  # of a script
        self.curves = analysis.curves
        self.bodies = {body.label: body for body in analysis.bodies}
        found = [
            self.bodies[finding.body]
            for finding in analysis.findings
            if finding.body in self.bodies
        ]
        moves = {
            body.label: sum(body.segments.values()) - body.segments["still"]
            for body in analysis.bodies
        }
        moving = sorted(analysis.bodies, key=lambda body: -moves[body.label])
        moving = [body for body in moving if moves[body.label]]
        told = [self.bodies[row.body] for row in analysis.account if row.body in self.bodies]
        self.about = [*{body.label: body for body in (*found, *told, *moving)}.values()]
        """The bodies of findings, most severe first, those of the account, then those that move."""

    def span_s(self, finding: Finding, body: BodyAnalysis) -> tuple[float, float] | None:
        """Return the time span of a finding; None if it covers almost the whole run."""
        steps = finding.steps
        if steps is None or steps.last - steps.first > WHOLE * self.analysis.samples:
            return None
        ends = np.array([steps.first, steps.last])
        first_s, last_s = self.curves.times_s(body.id, ends).tolist()
        return first_s, last_s

    def curve(
        self,
        body: BodyAnalysis,
        its: Curves,
        column: str,
        name: str,
        colour: str,
        look: Look = "line",
    ) -> Curve:
        """Return a column as a curve, with gaps where steps are missing."""
        steps, values = its.steps, its.columns[column]
        gaps = np.flatnonzero(np.diff(steps) > 1.5 * np.diff(steps).min(initial=len(steps))) + 1
        times_s = self.curves.times_s(body.id, steps)
        return Curve(
            name,
            np.insert(times_s, gaps, times_s[gaps]),
            np.insert(values, gaps, np.nan),
            colour,
            look,
            np.insert(steps, gaps, steps[gaps]),
        )


Kind = Callable[[Drawable, BodyAnalysis, Finding | None], Iterator[Panel]]
"""Function that yields the panels for a body, or for a finding about it."""


def joint(subject: Drawable, body: BodyAnalysis, finding: Finding | None) -> Iterator[Panel]:
    """Yield the panels of a joint and its motor: the finding's, or the one farthest off target."""
    rows = [row for row in body.joints if row.off is not None]
    if finding is not None:
        rows = [row for row in body.joints if row.name == finding.joint][:1]
    curves = subject.curves.joints(body.id)
    if not rows or curves is None or (finding is not None and finding.code in OF_FILES):
        return
    row = max(rows, key=lambda row: abs(row.off or 0.0))
    its = _joint_of(curves, body.joints.index(row))
    what = "rate" if row.control == "velocity" else "position"
    title = Message("{joint}: position", joint=row.name)
    if what == "rate":
        title = Message("{joint}: rate", joint=row.name)
    yield Panel(
        title,
        row.unit,
        [
            subject.curve(body, its, what, Message("reached"), colours.SIMULATED),
            subject.curve(body, its, TARGETS[what], Message("target"), "", "dashed"),
        ],
    )
    limits = [
        subject.curve(body, its, side, Message("limit"), "", "dashed") for side in _limits(its)
    ]
    title = Message("{joint}: torque of its motor", joint=row.name)
    window = _window(its.columns["torque"])
    if window > 1:
        times_s = subject.curves.times_s(body.id, its.steps[[0, window]])
        title = Message(
            "{joint}: torque of its motor, mean over {span:.2g} s",
            joint=row.name,
            span=times_s[1] - times_s[0],
        )
        padded = np.pad(its.columns["torque"], (window // 2, window - 1 - window // 2), "edge")
        its.columns["torque"] = np.convolve(padded, np.full(window, 1 / window), "valid")
    drawn = subject.curve(body, its, "torque", Message("torque"), colours.ROUNDING)
    yield Panel(title, row.torque_unit, [drawn, *limits], zero=True)


def of_row(subject: Drawable, row: AccountRow) -> Panel | None:
    """Return the curve for a row of the account: joint position, body energy or displacement."""
    body = subject.bodies.get(row.body or "")
    if body is None or row.time_s is None:
        return None
    joints, given_j = subject.curves.joints(body.id), subject.curves.energy(body.id)
    places = [place for place, each in enumerate(body.joints) if each.name == row.joint]
    if places and joints is not None:
        its = _joint_of(joints, places[0])
        drawn = [
            subject.curve(body, its, "position", Message("reached"), colours.SIMULATED),
            subject.curve(body, its, "target", Message("target"), "", "dashed"),
        ]
        title = Message("{joint}: position", joint=row.joint)
        return Panel(title, body.joints[places[0]].unit, drawn, moment_s=row.time_s)
    if row.kind == "energy" and given_j is not None:
        drawn = [subject.curve(body, given_j, "whole", Message("energy"), colours.SIMULATED)]
        title = Message("energy of {body} since the start", body=body.label)
        return Panel(title, "J", drawn, moment_s=row.time_s, zero=True)
    if row.kind != "moved" or row.joint is not None:
        return None
    columns = next(each.columns for each in subject.analysis.rows if each.body.number == body.id)
    places_m = np.stack([columns[f"{axis}_m"] for axis in "xyz"])
    known = np.isfinite(places_m).all(axis=0)
    if known.sum() < 2:
        return None
    far_m = np.linalg.norm(places_m[:, known] - places_m[:, known][:, :1], axis=0)
    curve = Curve(Message("distance"), columns["time_s"][known], far_m, colours.SIMULATED)
    title = Message("{body}: distance from where it began", body=body.label)
    return Panel(title, "m", [curve], moment_s=row.time_s, zero=True)


def friction(subject: Drawable, body: BodyAnalysis, finding: Finding | None) -> Iterator[Panel]:
    """Yield a panel of the friction force between a finding's two bodies, and its limit."""
    other = subject.bodies.get((finding and finding.other) or "")
    its = None if other is None else subject.curves.friction(body.id, other.id)
    if other is None or its is None or len(its.steps) < 2:
        return
    available, used = Message("available"), Message("used")
    yield Panel(
        Message("friction between {body} and {other}", body=body.label, other=other.label),
        "N",
        [
            subject.curve(body, its, "available", available, colours.FREE_FALL, "wide"),
            subject.curve(body, its, "used", used, colours.INTERACTION),
        ],
        zero=True,
    )


def heights(subject: Drawable, body: BodyAnalysis, finding: Finding | None) -> Iterator[Panel]:  # noqa: ARG001
    """Yield a panel of a flying body's height, compared with free fall."""
    longest = max((flight.last_step - flight.first_step for flight in body.flights), default=0)
    if longest <= FLIES * sum(body.segments.values()):
        return
    (rows,) = (row.columns for row in subject.analysis.rows if row.body.number == body.id)
    times_s, z_m, steps = rows["time_s"], rows["z_m"], rows["step"]
    fall_m = z_m - rows["error_z_m"]
    yield Panel(
        Message("height of {body}", body=body.label),
        "m",
        [
            Curve(Message("free fall"), times_s, fall_m, colours.FREE_FALL, "wide", steps),
            Curve(Message("simulated"), times_s, z_m, colours.SIMULATED, steps=steps),
        ],
    )


def energy(subject: Drawable, body: BodyAnalysis, finding: Finding | None) -> Iterator[Panel]:
    """Yield a panel of the causes that change a body's energy, whatever the finding."""
    its = subject.curves.energy(body.id)
    if its is None or finding is not None or body.energy is None:
        return
    sizes = {name: float(np.nanmax(np.abs(its.columns[name]), initial=0.0)) for name in FORCES}
    causes = sorted(FORCES, key=lambda name: -sizes[name])[:MOST_CAUSES]
    causes = [name for name in causes if sizes[name] > LEAST_SHARE * sizes[causes[0]]]
    if not causes or not its.columns["whole"].any():
        return
    drawn: dict[str, tuple[str, str]] = {"whole": (Message("together"), "")}
    drawn |= {name: (cause_in_words(name), colours.CAUSES[name]) for name in causes}
    yield Panel(
        Message("energy of {body} since the start, by cause", body=body.label),
        "J",
        [subject.curve(body, its, column, *how) for column, how in drawn.items()],
        zero=True,
    )


KINDS: tuple[Kind, ...] = (joint, friction, heights, energy)
"""All kinds of panels; for a finding, the first kind that can show it is used."""


def of_finding(
    subject: Drawable, finding: Finding, mark: str = "", done: frozenset[Kind] = frozenset()
) -> tuple[Kind | None, list[Panel]]:
    """Return the first kind of panel, not used yet, that shows a finding, and its panels."""
    body = subject.bodies.get(finding.body or "")
    if body is None:
        return None, []
    for kind in KINDS:
        if kind not in done and (panels := [*kind(subject, body, finding)]):
            span_s = subject.span_s(finding, body)
            return kind, [replace(panel, mark=mark, span_s=span_s) for panel in panels]
    return None, []


# -- joints side by side, for the viewer ----------------------------------------------------------


def side_by_side(subject: Drawable, bodies: Mapping[int, Body]) -> Iterator[Panel]:
    """Yield panels of position, rate and torque, for at most `MOST_JOINTS` joints of all bodies.

    Joints with findings come first, then those farthest from their targets.
    """
    named = [
        (finding.body, finding.joint)
        for finding in subject.analysis.findings
        if finding.code not in OF_FILES
    ]
    found = [
        (
            named.index((body.label, row.name)) if (body.label, row.name) in named else len(named),
            -abs(row.off or 0.0),
            body,
            place,
        )
        for body in subject.about
        for place, row in enumerate(body.joints)
    ]
    shown = sorted(found, key=lambda each: each[:2])[:MOST_JOINTS]
    several = len({body.id for *_, body, _ in shown}) > 1
    lines: dict[str, list[Curve]] = {"position": [], "rate": [], "torque": []}
    units: dict[str, dict[str, None]] = {what: {} for what in lines}
    for (*_, body, place), colour in zip(shown, colours.JOINTS, strict=False):
        curves, row = subject.curves.joints(body.id), body.joints[place]
        if curves is None:
            continue
        its = _joint_of(curves, place)
        name = row.name if len(row.name) <= JOINT else f"{row.name[: JOINT - 1]}…"
        name = f"{body.id} {name}" if several else name
        what = "rate" if row.control == "velocity" else "position"
        kinds = {what: [TARGETS[what]], "torque": []}
        if what == "position":
            kinds[what] += _stops(its, bodies[body.id], row)
        kinds["torque"] += _limits(its, REACHED)
        for which, others in kinds.items():
            lines[which].append(subject.curve(body, its, which, name, colour))
            # Under the same name, which the viewer lists once.
            lines[which] += [
                subject.curve(body, its, each, name, colour, "dashed")
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


def _joint_of(curves: Curves, place: int) -> Curves:
    """Return the curves of a body's joint, given the joint's index."""
    return Curves(curves.steps, {name: column[:, place] for name, column in curves.columns.items()})


def _window(torque: Float64) -> int:
    """Return the smoothing window of a torque in samples; 1 if the torque is smooth already."""
    jumps = np.diff(torque)
    if len(torque) < 4 * WINDOWS or not np.isfinite(jumps).all():
        return 1
    turns = float((jumps[1:] * jumps[:-1] < 0).mean())
    size = float(np.abs(jumps).mean()) / (float(np.ptp(torque)) or 1.0)
    return len(torque) // WINDOWS if turns > NOISY and size > JUMPS else 1


def _limits(its: Curves, far: float = FAR) -> list[str]:
    """Add the lower torque limit as a curve; return the limits that the torque comes near."""
    torque, limit = its.columns["torque"], its.columns["limit"]
    most = float(np.nanmax(np.abs(torque), initial=0.0))
    if np.nanmin(limit, initial=np.inf) > far * most:
        return []
    its.columns["-limit"] = -limit
    sides = [("limit", torque.max() > 0.5 * most), ("-limit", torque.min() < -0.5 * most)]
    return [side for side, near in sides if near]


def _stops(its: Curves, body: Body, row: JointRow) -> list[str]:
    """Add a joint's range limits as curves; return the limits that its position comes near."""
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

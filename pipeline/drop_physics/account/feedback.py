"""Finds the feedback by which a script computes its controls: joint, delay and target.

A controller of a joint gives u = -K q(t - l) - D v(t - l) + s(t), where s is smooth: the term of
its target. The joint of q and v, and the delay (l), are found by least squares: a controller is
exact, so the right ones leave no residual, and all others do. A policy that is not of this form
leaves a residual in any case, and has no row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from drop_physics.account.rows import AccountRow
from drop_physics.account.series import JointSeries
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.whole_state import state_law_of
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.driving import limited_motors
from drop_physics.messages import Message
from drop_physics.quantities import number, quantity
from drop_physics.trace.events import Actuator

LEAST, MOST, LATEST = 8, 240, (16, 4, 0)
"""Minimum number of controls to fit beyond the terms of the target; maximum number, taken from the
end; and maximum delay of a state, so that enough controls remain."""
MOST_LATE = LATEST[0]
DEGREES = 0.0, 1 / 3, 2 / 3
"""Numbers of Chebyshev polynomials that model a moving target, as shares of the number of controls:
0 stands for a constant target, the largest can follow a sine with five controls per period."""
LEFT, APART = 1e-3, 30.0
"""Maximum share of a control that the right joint leaves unexplained, and factor by which all other
joints leave more."""
LEAST_LEFT = 1e-9
"""Share of a control below which what is left is rounding error."""
NEAR = 10.0
"""Factor on LEFT for a first test, which uses only controls with a state at every delay."""
SAME = 0.01
"""Maximum relative difference between the gains fitted to each half of the controls."""
FLAT, LEVELS = 0.2, 8
"""Share of controls exactly at their maximum or minimum from which the bounds are reported, and
minimum number of distinct controls for such a report."""


@dataclass(frozen=True)
class Feedback:
    """The joint whose state a control was computed from, with gains, delay and fit."""

    joint: int
    """Index of the joint in the columns of `position` and `rate`."""
    late: int
    """Delay of the state, in controls."""
    stiffness: float
    """Fitted gain K, per rad or m."""
    damping: float
    """Fitted damping D, per rad/s or m/s."""
    damped: int | None = None
    """Index of the joint whose rate enters the control, where it is not `joint`."""


def feedback_of(control: Float64, position: Float64, rate: Float64) -> Feedback | None:
    """Find the joint from whose state a control was computed; None if none explains it.

    `control` has n equally spaced controls, shape (n,). `position` and `rate` are the states at the
    start of the steps in which these controls act, shape (n, joints).
    """
    kept = ~_extreme(control)
    found = (_fitted(control, position, rate, kept, share) for share in DEGREES)
    return next(filter(None, found), None)


def _fitted(
    control: Float64, position: Float64, rate: Float64, kept: Flags, share: float
) -> Feedback | None:
    joints = position.shape[1]
    size = float(np.linalg.norm(control[kept] - control[kept].mean())) if kept.any() else 0.0
    for latest in LATEST:
        aim, rows = _aim(kept, latest, share)
        if len(rows):
            break
    else:
        return None
    y = _without(aim, control[rows])
    if np.linalg.norm(y) <= 10 * LEFT * size:
        return None  # the aim alone is enough
    left = np.full((latest + 1, joints), np.inf)
    for late in range(latest + 1):
        q, v = (_without(aim, each[rows - late]) for each in (position, rate))
        left[late] = _left(y, q, v) / size
    late, joint = divmod(int(np.argmin(left)), joints)
    if not left[late, joint] < NEAR * LEFT:
        return None
    aim, rows = _aim(kept, late, share)  # all of those that have such a state
    y, q, v = (
        _without(aim, each) for each in (control[rows], position[rows - late], rate[rows - late])
    )
    left[late] = _left(y, q, v) / size
    best = float(left[late, joint])
    left[late, joint] = np.inf
    if not best < LEFT or not left.min() > APART * max(best, 1e-9):
        return None
    columns = np.stack([q[:, joint], v[:, joint]], axis=1)
    gains, *_ = np.linalg.lstsq(columns, y, rcond=None)
    halves = [
        np.linalg.lstsq(columns[half], y[half], rcond=None)[0]
        for half in (slice(None, len(y) // 2), slice(len(y) // 2, None))
    ]
    if not np.allclose(halves, gains, rtol=SAME, atol=SAME * float(np.abs(gains).max())):
        return None  # where a run diverges, its largest states hide the residual of all others
    small = np.abs(gains) * np.linalg.norm(columns, axis=0) < LEFT * size
    stiffness, damping = np.where(small, 0.0, -gains).tolist()
    return Feedback(joint, late, stiffness, damping)


def crossed_feedback_of(
    control: Float64, position: Float64, rate: Float64, own: int
) -> Feedback | None:
    """Find a control of a joint's own position and another joint's rate, as of a wrong index.

    The arrays are those of `feedback_of`; `own` is the index of the joint.
    """
    kept = ~_extreme(control)
    size = float(np.linalg.norm(control[kept] - control[kept].mean())) if kept.any() else 0.0
    for share in DEGREES:
        aim, rows = _aim(kept, 0, share)
        if not len(rows):
            continue
        y, q, v = (_without(aim, each) for each in (control[rows], position[rows], rate[rows]))
        if np.linalg.norm(y) <= 10 * LEFT * size:
            continue
        left = _left(y, q[:, [own]].repeat(q.shape[1], axis=1), v) / size
        damped = int(np.argmin(left))
        # Without the other's rate, and with that of any third joint, the control is not explained.
        others = [*np.delete(left, damped), float(_left(y, q[:, [own]], q[:, [own]])[0]) / size]
        best = max(float(left[damped]), LEAST_LEFT)
        if damped != own and best < LEFT and min(others) > APART * best:
            return Feedback(own, 0, 0.0, 0.0, damped)
    return None


def _of_whole_state(
    control: Float64, position: Float64, rate: Float64, own: int
) -> Feedback | None:
    """Find feedback from the states of all joints, where one joint explains too little.

    The gains are set to 0: those of one joint alone would not describe the controller.
    """
    law = state_law_of(control, position, rate, ~_extreme(control), MOST_LATE)
    return None if law is None else Feedback(law.follows(own), law.late, 0.0, 0.0)


def _aim(kept: Flags, latest: int, share: float) -> tuple[Float64, Int64]:
    """Return an orthonormal basis for smoothly varying targets, one row for each control.

    The rows are the controls from index `latest` on, which have a state at any delay up to
    `latest`; `kept` flags usable controls.
    """
    rows = np.flatnonzero(kept[latest:]) + latest
    degree = int(share * len(rows))
    if len(rows) - degree < LEAST:
        return np.empty((0, 0)), np.empty(0, np.int64)
    times = np.linspace(-1, 1, len(kept))[rows]
    return np.linalg.qr(chebyshev.chebvander(times, degree))[0], rows


def _without(aim: Float64, values: Float64) -> Float64:
    """Return values minus their fit by a smooth target, given by an orthonormal basis."""
    return np.asarray(values - aim @ (aim.T @ values))


def _left(y: Float64, q: Float64, v: Float64) -> Float64:
    """Return how much of y each joint's q and v leave unexplained, as a norm, shape (joints,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one = q / np.linalg.norm(q, axis=0)
        other = v - one * (one * v).sum(axis=0)
        other /= np.linalg.norm(other, axis=0)
        rest = y[:, None] - one * (one * y[:, None]).sum(axis=0)
        rest = rest - other * (other * rest).sum(axis=0)
    return np.asarray(np.nan_to_num(np.linalg.norm(rest, axis=0), nan=np.inf))


def _extreme(control: Float64) -> Flags:
    """Flag the controls at their maximum or minimum, if several controls share that value."""
    extreme = np.zeros(len(control), np.bool_)
    for bound in (control.max(), control.min()):
        its = control == bound
        if its.sum() > 1:
            extreme |= its
    return extreme


@dataclass(frozen=True)
class Aim:
    """The target that a script's controller drives a joint to, inferred from the controls."""

    target: Float64
    """Target position in each step, shape (n,) [rad] or [m]."""
    stiffness: float
    """Force or torque of the drive per unit of gap [N m/rad] or [N/m]."""


class GivenControls:
    """The controls that a script computed for a body's actuators, and their feedback.

    Parameters
    ----------
    subject
        The body with its size and weight.
    series
        The body's joints in n steps.
    controls
        The control of each actuator in these steps, shape (n,).
    words
        Formats times and names for rows.
    """

    def __init__(
        self,
        subject: MeasuredBody,
        series: JointSeries,
        controls: Mapping[Actuator, Float64],
        words: RowWords,
    ) -> None:
        self._subject, self._series, self._words = subject, series, words
        self.aims: dict[int, Aim] = {}
        """Target positions of the joints from whose current states controls are computed,
        by rate."""
        self.rows = [*self._rows(controls)]
        """Rows for controls that follow another joint, are delayed, have the wrong sign, or stay at
        bounds."""

    def stiffness(self, rate: int) -> float | None:
        """Return the stiffness of the script's controller of a joint [N m/rad, N/m]; else None."""
        return self.aims[rate].stiffness if rate in self.aims else None

    def _rows(self, controls: Mapping[Actuator, Float64]) -> Iterator[AccountRow]:
        updates = _updates(controls)
        if updates is None:
            return
        at, period = updates
        body = self._subject.body
        self._limit(controls)
        position, rate = self._series.before[at], self._series.rate[at - 1]
        known = np.flatnonzero(np.isfinite(position).all(axis=0) & np.isfinite(rate).all(axis=0))
        last = _unbroken(self._series.before[:, known], self._series.after[:, known], at)
        for actuator, given in controls.items():
            own, control = body.rate_of(actuator), given[at]
            if actuator.kind not in ("motor", "general"):
                continue
            if own not in known or not np.isfinite(control).all():
                continue
            assert own is not None
            if (row := self._bounded(actuator, own, control)) is not None:
                yield row
            states, its = (position[last][:, known], rate[last][:, known]), [*known].index(own)
            found = (
                feedback_of(control[last], *states)
                or crossed_feedback_of(control[last], *states, its)
                or _of_whole_state(control[last], *states, its)
            )
            if found is None:
                continue
            row = self._misled(actuator, own, found, known, at, period)
            if row is not None:
                yield row
            elif found.stiffness:
                self.aims[own] = self._aim(actuator, own, control, found, at)

    def _limit(self, controls: Mapping[Actuator, Float64]) -> None:
        """Note the force limit of motors whose control is at an end of its range."""
        series = self._series
        for own, at_limit, most in limited_motors(self._subject.body, controls):
            series.at_limit[:, own] |= at_limit
            series.limit[:, own] = np.fmin(series.limit[:, own], most)

    def _aim(
        self, actuator: Actuator, own: int, control: Float64, found: Feedback, at: Int64
    ) -> Aim:
        """Return the controller's target, (control + damping × rate) / stiffness + position."""
        q, v = self._series.before[at, own], self._series.rate[at - 1, own]
        target = q + (control + found.damping * v) / found.stiffness
        kept = ~_extreme(control)
        steps = np.arange(len(self._series))
        held = np.interp(steps, at[kept], target[kept])
        return Aim(np.round(held, 6), found.stiffness * actuator.gear * actuator.kp)

    def _bounded(self, actuator: Actuator, own: int, control: Float64) -> AccountRow | None:
        """Return the row for a control that the script itself limits to narrower bounds."""
        bound = float(control.max())
        low, high = actuator.ctrl_range or (-np.inf, np.inf)
        share = float((np.abs(control) == bound).mean())
        if control.min() != -bound or share < FLAT or len(np.unique(control)) < LEVELS:
            return None
        if not (low < -bound and bound < high):
            return None
        told = Message(
            "ctrl is exactly ±{bound} in {share:.0%} of the steps, and never beyond",
            bound=number(bound),
            share=share,
        )
        if actuator.ctrl_range is not None:
            told = told + Message(
                "; its range is {low} to {high}", low=number(low), high=number(high)
            )
        return self._row(actuator, own, told, 10.0, ("bounded", bound), bound, "")

    def _misled(
        self,
        actuator: Actuator,
        own: int,
        found: Feedback,
        known: Int64,
        at: Int64,
        period: int,
    ) -> AccountRow | None:
        """Return the row for a controller with another joint's state, a delay, or a wrong sign."""
        names, body = self._words.names, self._subject.body
        steps = self._series.steps[at[:1]]
        late_s = found.late * period * float(self._words.timesteps_s(self._subject, steps)[0])
        joint = int(known[found.joint])
        if joint != own:
            told = Message(
                "its control follows {other}, not {own}",
                other=names.rate(body, joint),
                own=names.rate(body, own),
            )
            return self._row(actuator, own, told, 1e3, ("follows",), late_s, "s")
        if found.damped is not None:
            told = Message(
                "its control takes the position of {own} and the rate of {other}",
                own=names.rate(body, own),
                other=names.rate(body, int(known[found.damped])),
            )
            return self._row(actuator, own, told, 1e3, ("damped",), late_s, "s")
        if found.late:
            told = Message(
                "its control is late: of the state {late} before ({controls} × {every})",
                late=quantity(late_s, "s"),
                controls=found.late,
                every=quantity(late_s / found.late, "s"),
            )
            # Sensors, too, are of the step before.
            salience = 10.0 if found.late * period > 1 else 0.3
            return self._row(actuator, own, told, salience, ("late", found.late), late_s, "s")
        if found.stiffness * actuator.gear * actuator.kp < 0:
            told = Message("its control drives it away: it grows with its own position")
            return self._row(actuator, own, told, 10.0, ("away",), late_s, "s")
        return None

    def _row(
        self,
        actuator: Actuator,
        own: int,
        told: Message,
        salience: float,
        group: tuple[object, ...],
        got: float,
        unit: str,
    ) -> AccountRow:
        return AccountRow(
            kind="given",
            joint=self._words.names.rate(self._subject.body, own),
            actuator=actuator.name,
            told=told,
            got=got,
            unit=unit,
            salience=salience,
            misled=True,
            subject=self._subject.body,
            group=(*group, self._subject.kind),
        )


def _unbroken(before: Float64, after: Float64, at: Int64) -> slice:
    """Return the last controls between which every state follows from the one before.

    `before` and `after` are the positions around each step, shape (n, joints); `at` has the steps
    in which a control changes. A state that was set, or reset, breaks the sequence.
    """
    breaks = 1 + np.flatnonzero((before[1:] != after[:-1]).any(axis=1))
    edges = [0, *np.searchsorted(at, breaks, side="right").tolist(), len(at)]
    begin, end = max(pairwise(edges), key=lambda spell: (min(spell[1] - spell[0], MOST), spell))
    return slice(max(begin, end - MOST), end)


def _updates(controls: Mapping[Actuator, Float64]) -> tuple[Int64, int] | None:
    """Return the rows before which the script changes its controls, and the usual interval."""
    if not controls:
        return None
    given = np.stack([*controls.values()], axis=1)
    changes = 1 + np.flatnonzero((np.diff(given, axis=0) != 0).any(axis=1))
    if len(changes) < LEAST:
        return None
    period = int(np.median(np.diff(changes)))
    at = np.arange(1 + (int(changes[0]) - 1) % period, len(given), period, dtype=np.int64)
    return (at, period) if np.isin(changes, at).all() else None

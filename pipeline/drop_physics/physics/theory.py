"""Closed-form motion of a body in the air, independent of timesteps and engines.

    v' = g - a v - b |v| v

is the equation of motion. For a body that moves along a line with velocity v, and with b given the
sign of v, it is v' = g - a v - b v².

With x = ln(ψ)/b this Riccati equation becomes ψ'' + a ψ' = b g ψ, a linear one, with the solution ψ
= e^(-at/2) [cosh ωt + (a/2 + b v0) sinh(ωt)/ω], where ω² = a²/4 + b g. All closed forms below are
special cases of this one. ω is imaginary while a body rises with little drag; cosh then becomes
cos.

A small drag displaces a body by far less than it falls. This displacement is not computed as the
difference of two large ones, but by a Taylor series, as long as the effect of the drag is small.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyint, polyval

from drop_physics.arrays import Float64, Vector
from drop_physics.physics.base import Drag

SERIES_REACH = 0.25
"""Maximum of rate × time for the series; beyond, the closed form loses at most two of 16 digits."""
SERIES_TERMS = 36
"""ψ e^(at/2) has no complex zero within rate x time = ln 2, and (0.25 / ln 2)^36 is 1e-16."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TheoreticalFall:
    """The release of a body, and its drag in the air.

    `gravity_m_s2` is the signed z component: negative pulls down; 0 and upward are allowed.
    """

    position_m: Vector
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    gravity_m_s2: float
    drag: Drag

    @property
    def height_m(self) -> float:
        """Initial height, along z [m]."""
        return self.position_m[2]


# -- without drag ---------------------------------------------------------------------------------


def free_fall_position(fall: TheoreticalFall, time_s: Float64) -> Float64:
    """Return x0 + v0 t + g t²/2 [m], shape (n, 3). Source: any textbook."""
    g = np.multiply.outer(time_s, (0.0, 0.0, fall.gravity_m_s2))
    return np.array(fall.position_m) + (np.array(fall.velocity_m_s) + g / 2) * time_s[:, None]


def free_fall_height(fall: TheoreticalFall, time_s: Float64) -> Float64:
    """Return the height in free fall [m], with the shape of `time_s`."""
    return free_fall_position(fall, time_s)[:, 2]


def free_fall_velocity(fall: TheoreticalFall, time_s: Float64) -> Float64:
    """Return the velocity in free fall, v0 + g t [m/s], shape (n, 3)."""
    v0 = np.array(fall.velocity_m_s, dtype=np.float64)
    return v0 + np.outer(time_s, (0.0, 0.0, fall.gravity_m_s2))


def timestep_displacement(fall: TheoreticalFall, time_s: Float64, timestep_s: float) -> Float64:
    """Return g t dt/2 [m], the error of semi-implicit Euler in free fall, shape (n, 3).

    The expression is exact, not only the leading term of the error: after step i the velocity is v0
    + i g dt, and the sum of n such steps is v0 t + g dt² n (n + 1)/2 = v0 t + g t²/2 + g t dt/2.
    """
    return np.multiply.outer(time_s, (0.0, 0.0, fall.gravity_m_s2 * timestep_s / 2))


def impact_time_free(fall: TheoreticalFall, floor_height_m: float) -> float | None:
    """Return when free fall reaches `floor_height_m` from above [s]; None if never.

    This is the first root of d + v0 t + g t²/2 = 0, computed without cancellation; 0 for a body
    that starts below the floor height.
    """
    d, v0, g = fall.height_m - floor_height_m, fall.velocity_m_s[2], fall.gravity_m_s2
    if d < 0 or (d == 0 and v0 <= 0):
        return 0.0
    speed_squared = v0 * v0 - 2 * g * d
    if speed_squared < 0 or (g >= 0 and v0 >= 0):
        return None
    speed = math.sqrt(speed_squared)
    return (v0 + speed) / -g if v0 > 0 else 2 * d / (speed - v0)


def stopped_by_floor(heights_m: Float64, floor_height_m: float | None) -> Float64:
    """Return heights of the body's centre [m], limited by the floor.

    `floor_height_m` is the height of the centre at which the body touches the floor, None without a
    floor. In tables, curves and plots, the theory ends at this height.
    """
    return heights_m if floor_height_m is None else np.maximum(heights_m, floor_height_m)


# -- with drag ------------------------------------------------------------------------------------


def damping_displacement(fall: TheoreticalFall, time_s: Float64) -> Float64:
    """Return x_damped - x_free [m], the displacement due to drag, shape (n, 3).

    Without cancellation. Times are not negative, in any order [s]. An oblique throw through
    quadratic drag is integrated, to 1e-12 m over the first metres.
    """
    return _motion(fall, time_s).change


def damped_fall_height(fall: TheoreticalFall, time_s: Float64) -> Float64:
    """Return the height of a falling body with drag [m], with the shape of `time_s`."""
    return fall.height_m + _motion(fall, time_s).travel[:, 2]


def impact_time_damped(fall: TheoreticalFall, floor_height_m: float) -> float | None:
    """Return when the damped fall reaches `floor_height_m` [s]; None if never."""
    free_s = impact_time_free(fall, floor_height_m)
    if not free_s or not any(fall.drag):
        return free_s  # with drag a body gets no further than in free fall
    v0, g, (a, b) = fall.velocity_m_s[2], fall.gravity_m_s2, fall.drag
    if math.isinf(a):
        return None  # the drag stops it at once

    def state(time: float) -> tuple[float, float]:
        motion = _motion(fall, np.array([time]))
        above = fall.height_m - floor_height_m + motion.travel[0, 2]
        return float(above), float(motion.velocity[0, 2])

    latest = free_s
    while g < 0 and state(latest)[0] > 0:
        latest *= 2
    if g > 0:  # it turns back up, sooner than in free fall
        latest = _time_of_zero(lambda time: (-state(time)[1], math.nan), -v0 / g)
    if g == 0:  # it only slows down; with e^-60 of its speed it no longer moves
        latest = 60 / a if a else _time_of_quadratic_drag(b, fall, floor_height_m)
    return _time_of_zero(state, latest) if state(latest)[0] <= 0 else None


def _time_of_quadratic_drag(b: float, fall: TheoreticalFall, floor_height_m: float) -> float:
    """Return the arrival time of a body without gravity [s], from its path ln(1 + b v t)/b.

    The body moves along its velocity, whose vertical component determines when it reaches the
    floor.
    """
    speed = math.hypot(*fall.velocity_m_s)
    way_m = (fall.height_m - floor_height_m) * speed / -fall.velocity_m_s[2]
    return 1.01 * math.expm1(min(b * way_m, 700.0)) / (b * speed)


def _time_of_zero(function: Callable[[float], tuple[float, float]], latest: float) -> float:
    """Return when `function`, given with its slope, decreases through 0 before `latest`.

    Newton's method, with bisection where it would leave the bracket or the slope is 0.
    """
    low, high, time = 0.0, latest, latest
    for _ in range(200):
        value, slope = function(time)
        low, high = (time, high) if value > 0 else (low, time)
        newton = time - value / slope if slope else math.nan
        following = newton if low < newton < high else (low + high) / 2
        if abs(following - time) <= 2**-52 * time or not low < following < high:
            return time
        time = following
    return time


# -- motion through drag --------------------------------------------------------------------------


class _Motion(NamedTuple):
    """Path from the start [m], difference from free fall [m], velocity [m/s]: (n, 3) or (n,)."""

    travel: Float64
    change: Float64
    velocity: Float64


def _motion(fall: TheoreticalFall, time: Float64) -> _Motion:
    time = np.asarray(time, dtype=np.float64)
    (vx, vy, vz), g, (a, b) = fall.velocity_m_s, fall.gravity_m_s2, fall.drag
    if max(a, b) < 1e-100:  # it changes no double, and its rate squared is 0
        v0, velocity = np.array(fall.velocity_m_s), free_fall_velocity(fall, time)
        return _Motion((v0 + velocity) / 2 * time[:, None], np.zeros_like(velocity), velocity)
    if b == 0:  # the axes are independent
        axes = [_leg(_Leg(a, 0.0, *axis), time) for axis in ((vx, 0.0), (vy, 0.0), (vz, g))]
        return _Motion(*(np.stack(each, axis=1) for each in zip(*axes, strict=True)))
    if vx == vy == 0:
        line, direction = _there_and_back(fall.drag, vz, g, time), np.array((0.0, 0.0, 1.0))
    elif g == 0:
        speed = math.hypot(vx, vy, vz)
        line, direction = _leg(_Leg(a, b, speed, 0.0), time), np.array((vx, vy, vz)) / speed
    else:
        return _oblique(fall, time)
    return _Motion(*(np.multiply.outer(each, direction) for each in line))


class _Leg(NamedTuple):
    """A motion along a line, v' = g - a v - b v² from v0, without reversal: b v >= 0."""

    a: float
    b: float
    v0: float
    g: float

    @property
    def omega_squared(self) -> float:
        return self.a * self.a / 4 + self.b * self.g


def _there_and_back(drag: Drag, v0: float, g: float, time: Float64) -> _Motion:
    """Return a vertical motion: up to its apex, if it has one, and down.

    The undamped body has another apex: its velocity at the damped body's apex, the slip, adds to
    the change from then on.
    """
    sign = math.copysign(1.0, v0 or g)
    a, b = drag
    there = _Leg(a, sign * b, v0, g)
    if v0 * g >= 0:
        return _leg(there, time)
    apex_s = _turning_time(there)
    back = _Leg(a, -sign * b, 0.0, g)
    after = np.maximum(time - apex_s, 0.0)
    up, down = _leg(there, np.minimum(time, apex_s)), _leg(back, after)
    slip = _velocity_change(there, apex_s)
    change = up.change + slip * after + down.change
    velocity = np.where(after > 0, down.velocity, up.velocity)
    return _Motion(up.travel + down.travel, change, velocity)


def _leg(leg: _Leg, time: Float64) -> _Motion:
    free = (leg.v0 + leg.g * time / 2) * time
    if math.isinf(leg.a):  # it stops at once
        return _Motion(0 * time, -free, np.where(time > 0, 0.0, leg.v0))
    near = _rate(leg) * time <= SERIES_REACH
    series = polyint(_velocity_series(leg)) / _rate(leg)
    change = polyval(_rate(leg) * np.where(near, time, 0.0), series)
    travel = np.where(near, free + change, _travel(leg, time))
    return _Motion(travel, np.where(near, change, travel - free), _velocity(leg, time))


def _rate(leg: _Leg) -> float:
    """Return the rate of the drag [1/s]: ψ e^(at/2) has no zero within rate x time = ln 2."""
    return math.sqrt(abs(leg.omega_squared)) + leg.a / 2 + leg.b * leg.v0 or 1.0


@functools.lru_cache(maxsize=64)
def _velocity_series(leg: _Leg) -> Float64:
    """Return the coefficients of v - v_free [m/s] in powers of x = rate t.

    From v' = g - a v - b v²: (n + 1) c_{n+1} = -a c_n - b (c_0 c_n + ... + c_n c_0); the further g
    in c_1, as in free fall, is left out of the result.
    """
    a, b, g = leg.a / _rate(leg), leg.b / _rate(leg), leg.g / _rate(leg)
    velocity, change = [leg.v0], [0.0]
    for n in range(SERIES_TERMS):
        square = math.fsum(x * y for x, y in zip(velocity, reversed(velocity), strict=True))
        change.append((-a * velocity[n] - b * square) / (n + 1))
        velocity.append(change[-1] + (g if n == 0 else 0.0))
    return np.array(change)


def _travel(leg: _Leg, time: Float64) -> Float64:
    """Return ln(ψ)/b [m]: the terminal velocity v_t = g/(ω + a/2) times t, and the transient.

        v_t t + ln[1 + b (v0 - v_t) (1 - e^(-2ωt)) / 2ω] / b

    With b = 0 that is v_t t + (v0 - v_t) (1 - e^(-at))/a; with v_t = 0, ln[1 + v0 (1 - e^(-kt))]/k.
    For imaginary ω = iν, ψ = e^(-at/2) [cos νt + (a/2 + b v0) sin(νt)/ν] is used directly.
    """
    if leg.omega_squared < 0:
        nu = math.sqrt(-leg.omega_squared)
        beta = leg.a / 2 + leg.b * leg.v0
        swing = beta / nu * np.sin(nu * time) - 2 * np.sin(nu * time / 2) ** 2
        return np.asarray((np.log1p(swing) - leg.a / 2 * time) / leg.b)
    omega = math.sqrt(leg.omega_squared)
    terminal = leg.g / (omega + leg.a / 2) if leg.g else 0.0
    decayed = -np.expm1(-2 * omega * time) / (2 * omega) if omega else time
    transient = (leg.v0 - terminal) * decayed
    return terminal * time + (np.log1p(leg.b * transient) / leg.b if leg.b else transient)


def _velocity(leg: _Leg, time: Float64) -> Float64:
    """Return ψ'/(bψ) [m/s] = [v0 + (g - a v0/2) T] / [1 + (a/2 + b v0) T], T = tanh(ωt)/ω.

    It does not cancel or overflow; T is tan(νt)/ν for ω = iν, and t for ω = 0.
    """
    root = math.sqrt(abs(leg.omega_squared))
    tangent = np.tan if leg.omega_squared < 0 else np.tanh
    t = tangent(root * time) / root if root else time
    gain, loss = leg.g - leg.a * leg.v0 / 2, leg.a / 2 + leg.b * leg.v0
    return (leg.v0 + gain * t) / (1 + loss * t)


def _velocity_change(leg: _Leg, time: float) -> float:
    """Return v - v_free [m/s], without cancellation within the reach of the series."""
    if _rate(leg) * time <= SERIES_REACH:
        return float(polyval(_rate(leg) * time, _velocity_series(leg)))
    return float(_velocity(leg, np.array(time))) - leg.v0 - leg.g * time


def _turning_time(leg: _Leg) -> float:
    """Return the time at which a motion against gravity stops [s]: the numerator of v is 0.

    tanh(ωt)/ω = -v0/(g - a v0/2), solved for t without cancellation for weak gravity.
    """
    if leg.omega_squared < 0:
        nu = math.sqrt(-leg.omega_squared)
        return math.atan(nu * -leg.v0 / (leg.g - leg.a * leg.v0 / 2)) / nu
    omega = math.sqrt(leg.omega_squared)
    slowing = leg.g + leg.b * leg.v0 * leg.g / (omega + leg.a / 2)
    return math.log1p(-2 * omega * leg.v0 / slowing) / (2 * omega) if omega else -leg.v0 / slowing


STRAIGHT = 1e-9
"""Share of the sideways velocity in the speed, below which the drag does not depend on it: its
square is rounding."""


def _oblique(fall: TheoreticalFall, time: Float64) -> _Motion:
    """Integrate an oblique throw: δ'' = -v (a + b |v|) with v = v_free + δ', δ the change.

    No closed form is known: |v| couples the directions. δ/k is integrated, with k the larger of a
    and b: it does not shrink with them, which keeps the relative accuracy at small damping. DOP853
    is Hairer's, in scipy. Once the drag has stopped the sideways motion, to within `STRAIGHT`/k,
    the motion is vertical and continues in closed form.
    """
    from scipy.integrate import solve_ivp  # slow to import, and needed here only

    (vx, vy, vz), g, k = fall.velocity_m_s, fall.gravity_m_s2, max(fall.drag)
    linear, quadratic = fall.drag.linear_per_s / k, fall.drag.quadratic_per_m / k

    def velocity(t: float, y: Float64) -> tuple[float, float, float]:
        _, _, _, wx, wy, wz = y.tolist()
        return vx + k * wx, vy + k * wy, vz + g * t + k * wz

    def derivative(t: float, y: Float64) -> tuple[float, ...]:
        ux, uy, uz = velocity(t, y)
        drag = -linear - quadratic * math.sqrt(ux * ux + uy * uy + uz * uz)
        return *y[3:].tolist(), drag * ux, drag * uy, drag * uz

    def sideways(t: float, y: Float64) -> float:
        ux, uy, uz = velocity(t, y)
        return math.hypot(ux, uy) - STRAIGHT * abs(uz)

    sideways.terminal, sideways.direction = True, -1  # type: ignore[attr-defined]
    moments, back = np.unique(np.append(time, 0.0), return_inverse=True)
    solution = solve_ivp(
        derivative,
        (0, moments[-1] or 1),
        np.zeros(6),
        "DOP853",
        moments,
        events=sideways,
        rtol=1e-13,
        atol=1e-30,
    )
    change = k * solution.y.T
    free_m_s = free_fall_velocity(fall, moments)
    free_m = (np.array(fall.velocity_m_s) + free_m_s) / 2 * moments[:, None]
    if len(change) < len(moments):
        assert solution.t_events is not None
        assert solution.y_events is not None
        begins, state = float(solution.t_events[0][0]), solution.y_events[0][0]
        at = np.array((vx, vy, vz)) * begins + k * state[:3]
        at[2] += g * begins**2 / 2
        line = _there_and_back(
            fall.drag, velocity(begins, state)[2], g, moments[len(change) :] - begins
        )
        later = np.zeros((len(moments) - len(change), 6))
        later[:, :3] = at - free_m[len(change) :]
        later[:, 3:] = -free_m_s[len(change) :]
        later[:, 2] += line.travel
        later[:, 5] += line.velocity
        change = np.vstack((change, later))
    change = change[back[:-1]]
    travel, velocities = free_m[back[:-1]], free_m_s[back[:-1]]
    return _Motion(travel + change[:, :3], change[:, :3], velocities + change[:, 3:])

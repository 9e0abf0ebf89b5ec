"""Constraints: whether they meet where they join, and whether they are strong enough."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joined import FIXED, POINT
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.laws.bullet.reports import frame_axes
from drop_physics.physics.rotations import matrix
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span
from drop_physics.rules.arguments import given, number, site_of
from drop_physics.rules.body_properties import size_m, strained_by
from drop_physics.rules.held_off import to_spare
from drop_physics.rules.thresholds import APART, APART_RAD, CLOSES
from drop_physics.trace.acts import CONSTRAINS, SETS_TIMESTEP, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

ROLES = "parent", "child"
DEFAULT_N_S = 500.0
"""The largest impulse of a step where no call gives a force."""
DEFAULT_TIMESTEP_S = 1 / 240
TAIL = 10
"""Steps in which something must stay as it is."""
STILL_M_S = 1e-3
FULL = 1 - 1e-6
RATIO = 10.0
"""Of masses, beyond which it takes the solver many iterations."""
STAYS = 0.99
"""Share of a gap that is left, ten steps on, where nothing closes it: what hangs there swings."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class _Frame(NamedTuple):
    """What a constraint joins: of a link's centre of mass in its axes, or of the world."""

    point_m: tuple[float, ...]
    orientation: tuple[float, ...]
    """Quaternion x, y, z, w."""


class _Apart(NamedTuple):
    """How far the two frames of a constraint are apart."""

    gap_m: float
    angle_rad: float
    """0 where the constraint closes no angle."""


@dataclass
class _Joined:
    """A constraint that closes all distance between its two points."""

    call: Call
    fixed: bool
    """Whether it closes the angle between its frames as well."""
    bodies: tuple[Body | None, Body | None]
    """None is the world."""
    links: tuple[int, int]
    frames: list[_Frame]
    impulse_n_s: float = DEFAULT_N_S
    force_call: Call | None = None
    changed: int = -1
    """Steps before the last call that moved it."""
    since: int = -1
    """Steps before its limit was changed last."""
    first: _Apart | None = None
    """Before its first step."""
    closed: _Apart | None = None
    """The least after one of its first steps."""
    first_frames: list[list[_Frame]] = field(default_factory=list)
    """As it was created, and as it was at its first step."""
    tail: Float64 = field(default_factory=lambda: np.empty((0, 2, 3)))
    """Where its points were at the last samples."""
    forces: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    last: int = -1
    weight_n: float = 0.0
    """Of what is held, along the axis on which it is most; 0 if it does not hang here alone."""
    full: int = 0
    timestep_s: float = DEFAULT_TIMESTEP_S


class Joined(Answer):
    """Follows the points that each constraint joins."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._now: dict[tuple[int, int], _Joined] = {}
        self._all: list[_Joined] = []
        self._timestep_s: dict[int, float] = {}
        self._touched: dict[int, int] = {}
        """By the number of a body, the last sample that a contact led to."""

    def see(self) -> None:
        """Take calls, then the points' ways."""
        self._told()
        pairs = self.scene.touches.pairs
        sites = self.scene.piece.calls.sites.values()
        joins = any(site.act is Act.CONSTRAIN for site in sites)
        for first, second, rows in pairs.by_pair() if joins else ():
            step = int(pairs.step[rows[-1]])
            for one in (first, second):
                self._touched[one] = max(step, self._touched.get(one, step))
        for key, (steps, forces) in self.scene.piece.forces.items():
            joined = self._now.get(key)
            if joined is not None and len(steps):
                self._follow(joined, steps, forces)

    def _told(self) -> None:
        for call in self.scene.piece.calls.of(*SETS_TIMESTEP, *CONSTRAINS):
            if call.act in SETS_TIMESTEP:
                if (timestep_s := call.timestep_s) is not None:
                    self._timestep_s[call.client] = timestep_s
                    for key, joined in self._now.items():
                        if key[0] == call.client:
                            joined.since, joined.full = call.at.step, 0
            elif call.act is Act.CONSTRAIN and np.isfinite(call.result):
                self._create(call)
            else:
                key = call.client, int(number(call, "userConstraintUniqueId", -1.0))
                if key in self._now:
                    self._change(call, self._now[key])

    def _create(self, call: Call) -> None:
        key = call.client, int(call.result)
        self._now.pop(key, None)
        kind = int(number(call, "jointType", -1.0))
        if kind not in (FIXED, POINT):
            return
        ids = [int(number(call, f"{role}BodyUniqueId", -1.0)) for role in ROLES]
        came = [None if each < 0 else self.scene.piece.calls.body_at(call, each) for each in ids]
        if any(each >= 0 and found is None for each, found in zip(ids, came, strict=True)):
            return
        links = [int(number(call, f"{role}LinkIndex", -1.0)) for role in ROLES]
        frames = [
            _Frame(given(call, f"{role}FramePosition") or (0.0,) * 3, _turned(call, f"{role}Frame"))
            for role in ROLES
        ]
        parent, child = (None if each is None else each.body for each in came)
        joined = _Joined(
            call,
            kind == FIXED,
            (parent, child),
            (links[0], links[1]),
            frames,
            changed=call.at.step,
            first_frames=[frames],
        )
        self._now[key] = joined
        self._all.append(joined)

    def _change(self, call: Call, joined: _Joined) -> None:
        if force := given(call, "maxForce"):
            timestep_s = self._timestep_s.get(call.client, DEFAULT_TIMESTEP_S)
            impulse_n_s = force[0] * timestep_s
            if impulse_n_s != joined.impulse_n_s:
                joined.impulse_n_s, joined.force_call = impulse_n_s, call
                joined.since, joined.full = call.at.step, 0
        parent, child = joined.frames
        pivot = given(call, "jointChildPivot")
        moved = _Frame(
            pivot if len(pivot) == 3 else child.point_m,
            _turned(call, "jointChildFrame", child.orientation),
        )
        if moved != child:
            joined.frames, joined.changed = [parent, moved], call.at.step
            if call.at.step == joined.call.at.step:
                joined.first_frames.append(joined.frames)

    def _follow(self, joined: _Joined, steps: Int64, forces: Float64) -> None:
        begin = joined.call.at.step + 1
        if joined.first is None and steps[0] == begin:
            apart = [
                self._apart(joined, steps[:1], each, after=False) for each in joined.first_frames
            ]
            joined.first = _least(apart)
        if joined.first is not None and steps[0] < begin + TAIL and joined.changed < begin:
            soon = steps[: int(np.searchsorted(steps, begin + TAIL))]
            joined.closed = _least(
                [joined.closed, self._apart(joined, soon, joined.frames, after=True)]
            )
        timestep_s = self._timestep_s.get(joined.call.client, DEFAULT_TIMESTEP_S)
        joined.timestep_s, joined.last = timestep_s, int(steps[-1])
        full = np.abs(forces[:, :3]).max(axis=1) >= joined.impulse_n_s / timestep_s * FULL
        joined.full += int((full & (steps > joined.since)).sum())
        tail = steps[-TAIL - 1 :]
        ends = self._ends(joined, tail, joined.frames, after=True)
        if ends is None:
            joined.tail = joined.tail[:0]
            return
        joined.tail = np.concatenate((joined.tail, ends[0]))[-TAIL - 1 :]
        joined.forces = np.concatenate((joined.forces, forces[-TAIL:, :3]))[-TAIL:]
        joined.weight_n = self._weight_n(joined)

    def _apart(
        self, joined: _Joined, samples: Int64, frames: list[_Frame], *, after: bool
    ) -> _Apart | None:
        """Return how close two frames come at samples, or at the beginning of the steps to them."""
        ends = self._ends(joined, samples, frames, after=after)
        if ends is None:
            return None
        points_m, axes = ends
        turned = np.einsum("nji,njk->nik", axes[:, 0], axes[:, 1])
        cosine = ((np.trace(turned, axis1=1, axis2=2) - 1) / 2).clip(-1, 1)
        angle_rad = float(np.arccos(cosine).min()) if joined.fixed else 0.0
        return _Apart(
            float(np.linalg.norm(points_m[:, 0] - points_m[:, 1], axis=1).min()), angle_rad
        )

    def _ends(
        self, joined: _Joined, samples: Int64, frames: list[_Frame], *, after: bool
    ) -> tuple[Float64, Float64] | None:
        """Return points and axes of both frames, shape (n, 2, 3) and (n, 2, 3, 3)."""
        ends = [self._end(joined, side, samples, frames[side], after=after) for side in range(2)]
        if ends[0] is None or ends[1] is None:
            return None
        points_m, axes = zip(*ends, strict=True)
        return np.stack(points_m, axis=1), np.stack(axes, axis=1)

    def _end(
        self, joined: _Joined, side: int, samples: Int64, frame: _Frame, *, after: bool
    ) -> tuple[Float64, Float64] | None:
        """Return one frame's point and axes, shape (n, 3) and (n, 3, 3); None if not known."""
        body, link = joined.bodies[side], joined.links[side]
        turn = matrix(frame.orientation)
        if body is None:
            return np.tile(frame.point_m, (len(samples), 1)), np.tile(turn, (len(samples), 1, 1))
        found: list[tuple[Float64, Float64]] = []
        for _, steps in self.scene.stretches(body.number):
            rows = np.flatnonzero(np.isin(steps.steps, samples))
            if len(rows) and link < steps.law.tree.links:
                kin = kinematics(steps.law.tree, (steps.after if after else steps.before).at(rows))
                axes = frame_axes(kin, link, frame.orientation)
                found.append((kin.point_m(link, frame.point_m), axes))
        if body.number not in self.scene.judged and link == BASE:  # it stands where calls put it
            puts = [each for each in self.scene.seen.puts if each.body.number == body.number]
            bases = [each.base for each in puts if each.at.step < samples[-1]][-1:]
            for base in bases:
                stands = matrix(base[3:7].tolist())
                point_m = base[:3] + stands @ frame.point_m
                found = [
                    (
                        np.tile(point_m, (len(samples), 1)),
                        np.tile(stands @ turn, (len(samples), 1, 1)),
                    )
                ]
        if sum(len(points_m) for points_m, _ in found) != len(samples):
            return None
        points_m, all_axes = zip(*found, strict=True)
        return np.concatenate(points_m), np.concatenate(all_axes)

    def findings(self) -> Iterator[Finding]:
        """Yield the constraints that do not meet, and those that give way."""
        for each in self._all:
            apart = _apart(each)
            if apart is not None:
                yield apart
            weak = None if self._leans(each) else _weak(each, self._ratio(each.call.client))
            if weak is not None:
                yield weak

    def _weight_n(self, joined: _Joined) -> float:
        moving = [each for each in joined.bodies if each is not None and each.base_moves]
        if len(moving) != 1 or sum(moving[0] in each.bodies for each in self._now.values()) != 1:
            return 0.0
        weights_n = [
            np.abs(steps.law.tree.masses_kg.sum() * steps.reported.gravity_m_s2[-1]).max()
            for _, steps in self.scene.stretches(moving[0].number)
        ]
        return float(weights_n[-1]) if weights_n else 0.0

    def _ratio(self, client: int) -> float:
        """Return what the solver has to bear of points that meet and that no call moved."""
        mine = [each for each in self._all if each.call.client == client]
        bodies = {body.number: body for each in mine for body in each.bodies if body is not None}
        meet = all(_meets(each) and each.changed == each.call.at.step for each in mine)
        return strained_by(self.scene.seen, bodies.values()) if meet else 0.0

    def _leans(self, joined: _Joined) -> bool:
        """Whether something that one of its bodies touches may hold it off, at the end."""
        numbers = [body.number for body in joined.bodies if body is not None]
        return any(self._touched.get(number, -1) >= joined.last - TAIL for number in numbers)


def _names(joined: _Joined) -> tuple[str, str | None, str]:
    """Return the body that is held, the other one, and what the other one is called."""
    parent, child = joined.bodies
    held = child or parent
    other = None if parent is None or child is None else parent.label
    return ("" if held is None else held.label), other, other or Message("the world")


def _size_m(joined: _Joined) -> float:
    """Return the size of the smaller part: the diagonal of its box, or else its body's size."""
    sizes: list[float] = []
    for body, link in zip(joined.bodies, joined.links, strict=True):
        if body is not None:
            box = np.array(body.bounds_m[6 * (link + 1) : 6 * (link + 2)])
            diagonal = float(np.linalg.norm(box[3:] - box[:3])) if len(box) == 6 else 0.0
            sizes.append(diagonal or size_m(body))
    return min(sizes)


def _turned(call: Call, frame: str, default: tuple[float, ...] = UPRIGHT) -> tuple[float, ...]:
    """Return a frame's orientation; PyBullet passes over one that is not four numbers."""
    orientation = given(call, f"{frame}Orientation")
    return orientation if len(orientation) == 4 else default


def _least(apart: list[_Apart | None]) -> _Apart | None:
    known = [each for each in apart if each is not None]
    return _Apart(*map(min, zip(*known, strict=True))) if known else None


def _meets(joined: _Joined) -> bool:
    return joined.first is None or not joined.first.gap_m > APART * _size_m(joined)


def _apart(joined: _Joined) -> Finding | None:
    """Return that a constraint pulls together what was apart, if it did: a spring does not."""
    first, closed = joined.first, joined.closed
    if first is None or closed is None:
        return None
    size, (held, other, name) = _size_m(joined), _names(joined)
    values = {"body": held, "other": name, "gap": first.gap_m, "angle": first.angle_rad}
    if first.gap_m > APART * size and closed.gap_m < CLOSES * first.gap_m:
        message = Message(
            "{body} is joined to {other} at points that are {gap:.3g} m apart, which the "
            "constraint pulls together",
            **values,
        )
        advice = Message(
            "give p.createConstraint the parentFramePosition and childFramePosition of "
            "one and the same point"
        )
        effect, share = Effect(first.gap_m, "m"), first.gap_m / size
    elif first.angle_rad > APART_RAD and closed.angle_rad < CLOSES * first.angle_rad:
        message = Message(
            "{body} is joined to {other} in frames that are turned by {angle:.2g} rad, which the "
            "constraint turns back",
            **values,
        )
        advice = Message(
            "give p.createConstraint the parentFrameOrientation and childFrameOrientation of "
            "one and the same frame"
        )
        effect, share = Effect(first.angle_rad, "rad"), first.angle_rad
    else:
        return None
    step = joined.call.at.step + 1
    return Finding(
        code="constraint-apart",
        level="asked",
        message=message,
        body=held,
        other=other,
        advice=advice,
        cure=Cure("constraint-frames"),
        effect=effect,
        share=share,
        steps=Span(step, step, 1),
        site=site_of(joined.call),
    )


def _weak(joined: _Joined, ratio: float) -> Finding | None:
    limit_n = joined.impulse_n_s / joined.timestep_s
    if len(joined.tail) <= TAIL or joined.last - joined.changed <= TAIL:
        return None
    gaps = np.linalg.norm(joined.tail[:, 0] - joined.tail[:, 1], axis=1)
    moved = np.linalg.norm(joined.tail[-1] - joined.tail[0], axis=1)
    still = moved < STILL_M_S * TAIL * joined.timestep_s
    strained = (np.abs(joined.forces).max(axis=1) >= limit_n * FULL).all()
    # What one side drags lags with any force, and what is being pulled back needs time.
    if not (still.any() and gaps[-1] >= gaps[0] * STAYS and gaps[-1] > 1e-6):
        return None
    held, other, name = _names(joined)
    size, gap_m = _size_m(joined), float(gaps[-1])
    span = Span(joined.call.at.step + 1, joined.last, joined.full)
    if strained:
        why = Message(
            "that is at its limit of {limit:.3g} N along an axis in {count:,} steps",
            limit=limit_n,
            count=joined.full,
        )
        advice = Message("give it more: p.changeConstraint(…, maxForce=…)")
        cure = Cure("constraint-force")
        if joined.weight_n > limit_n:
            why = Message(
                "{why}, and the weight is {weight:.3g} N", why=why, weight=joined.weight_n
            )
            enough = to_spare(joined.weight_n)
            advice = Message("give it more: p.changeConstraint(…, maxForce={force})", force=enough)
            cure = Cure("constraint-force", value=float(enough))
            if joined.force_call and number(joined.force_call, "maxForce") > joined.weight_n:
                advice = Message("call p.setTimeStep before p.changeConstraint(…, maxForce=…)")
                cure = Cure("timestep-first")
    elif ratio >= RATIO and gap_m > APART * size:
        why = Message(
            "of what constraints join, one is {ratio:.3g} times as heavy as another, and the "
            "solver uses up its iterations",
            ratio=ratio,
        )
        advice = Message("raise p.setPhysicsEngineParameter(numSolverIterations=500)")
        cure = Cure("solver", value=500.0)
        span = Span(joined.last - TAIL + 1, joined.last, TAIL)
    else:
        return None
    message = Message(
        "{body} is {gap:.3g} m from where its constraint to {other} wants it: {why}",
        body=held,
        gap=gap_m,
        other=name,
        why=why,
    )
    return Finding(
        code="weak-constraint",
        level="asked",
        message=message,
        body=held,
        other=other,
        advice=advice,
        cure=cure,
        effect=Effect(gap_m, "m"),
        share=gap_m / size,
        steps=span,
        site=site_of(joined.force_call or joined.call),
    )

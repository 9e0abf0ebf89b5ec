"""What the findings on a script's recording are drawn from."""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.general.contacts import Contacts
from drop_physics.analysis.general.samples import motion_of
from drop_physics.analysis.script.edges import box_m, corners_of, edges_of
from drop_physics.analysis.script.judged import Judged
from drop_physics.analysis.script.results import BodyAnalysis, ScriptFinding
from drop_physics.analysis.times import Times
from drop_physics.laws.rotations import rotate_inverse
from drop_physics.messages import Message
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Appearance, At, Body, Dynamics, Pose, order
from drop_physics.seen.history import OfBody, Seen
from drop_physics.states import BASE

Float64 = NDArray[np.float64]
Moment = tuple[int, float]
"""Steps and calls before it: the sort key of an event (`order`)."""

OVERLAP_M = 1e-3
"""A body that overlaps another by more than this when it appears does not just touch it."""
OFTEN = 5
"""If the solver stops early in this many of the steps examined, it is not just an impact."""
OF_ALL = ("restoreState",)
"""Calls that change every body."""


class Slab(NamedTuple):
    """A body that nothing passes through, in the steps in which it stood where it appeared."""

    body: Body
    low_m: Float64
    high_m: Float64
    after: int
    """The step after which it appeared."""
    until: float
    """The last step in which it stood there."""


@dataclass(frozen=True)
class Evidence:
    """A script's recording, and the analysis of its bodies."""

    seen: Seen
    judged: Mapping[int, Judged]
    """By body number; of those that have samples."""
    contacts: Contacts
    times: Mapping[int, Times]
    """By client."""
    bodies: list[BodyAnalysis]
    samples: Mapping[int, int]
    """Number of samples of each client."""

    @cached_property
    def set_bodies(self) -> frozenset[int]:
        """Bodies that calls have moved after they appeared."""
        return frozenset(number for number, record in self.seen.by_body.items() if record.moves)

    @cached_property
    def pairs(self) -> tuple[NDArray[np.intp], list[int]]:
        """The pair of each contact point, as a number, and one point of each pair.

        A pair is two parts under the same reports of the engine: with another mass it is another.
        """
        contacts = self.contacts
        names = ("body_a", "link_a", "body_b", "link_b")
        points = pl.DataFrame(
            {
                **{name: getattr(contacts, name) for name in names},
                "report_a": self._reports(contacts.body_a),
                "report_b": self._reports(contacts.body_b),
            }
        )
        pairs = points.with_row_index("point").group_by(points.columns, maintain_order=True).first()
        which = points.join(
            pairs.with_row_index(), on=points.columns, how="left", maintain_order="left"
        )
        return which["index"].to_numpy().astype(np.intp), pairs["point"].to_list()

    @cached_property
    def pressed(self) -> frozenset[int]:
        """Bodies that ever touched several others."""
        touched: dict[int, set[int]] = {}
        for point in self.pairs[1]:
            (body_a, _), (body_b, _) = self.sides(point)
            touched.setdefault(body_a, set()).add(body_b)
            touched.setdefault(body_b, set()).add(body_a)
        return frozenset(body for body, others in touched.items() if len(others) > 1)

    @cached_property
    def put_inside(self) -> frozenset[int]:
        """Bodies that were deep in something as they appeared, or where a call put them."""
        contacts, inside = self.contacts, set()
        deep = contacts.distance_m < -OVERLAP_M
        step, bodies = contacts.step[deep], (contacts.body_a[deep], contacts.body_b[deep])
        for number, record in self.seen.by_body.items():
            its = (bodies[0] == number) | (bodies[1] == number)
            if np.isin(step[its], list(first_steps(record))).any():
                inside.add(number)
        return frozenset(inside)

    @cached_property
    def unconverged(self) -> frozenset[int]:
        """Clients whose solver often stops early, though nothing was put deep into something.

        There, contacts may contradict each other, and no number of iterations settles that.
        """
        inside = {self.seen.bodies[number].client for number in self.put_inside}
        early = {solver.client for solver in self.seen.solvers if solver.steps >= OFTEN}
        return frozenset(early - inside)

    def _reports(self, bodies: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return how many reports of the engine precede those on the body of each contact point."""
        reports = sorted((each.body.number, each.at.step) for each in self.seen.dynamics)
        # In one number: a body, and the steps before; a point belongs to the step before its own.
        known = np.array([(body << 40) + step for body, step in reports], np.int64)
        return np.searchsorted(known, (bodies << 40) + self.contacts.step - 1, side="right")

    def sides(self, row: int) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return body and link of both sides of a contact point."""
        contacts = self.contacts
        return (
            (int(contacts.body_a[row]), int(contacts.link_a[row])),
            (int(contacts.body_b[row]), int(contacts.link_b[row])),
        )

    @cached_property
    def slabs(self) -> list[Slab]:
        """Fixed boxes and planes, from when they appeared until they were moved or removed."""
        slabs = []
        for number, record in self.seen.by_body.items():
            if number in self.judged:
                continue
            gone = [
                order(each.at)
                for each in self.seen.appearances
                if each.body.number == number and not each.there
            ]
            for came in record.came:
                body, began = came.body, order(came.at)
                corners_m = corners_of(body, self._orientation(came, BASE))
                if corners_m is None:
                    continue
                moves = (order(put.at) for put in record.moves)
                ends = [at for at in (*gone, *moves) if at > began]
                until = min(ends, default=(math.inf, 0))[0]
                slabs.append(Slab(body, *corners_m, began[0], until))
        return slabs

    def dynamics_of(self, body: int) -> list[Dynamics]:
        """Return what the engine reported of a body, in order."""
        return self.seen.by_body[body].dynamics if body in self.seen.by_body else []

    def reported(self, name: str, body: int, link: int, at: Moment) -> float:
        """Return what the engine last reported of a part at a moment; nan where it is unknown."""
        dynamics = self.dynamics_of(body)
        last = bisect_right(self._moments["dynamics"][body], at) - 1 if dynamics else 0
        values = dynamics[max(last, 0)].reported[name] if dynamics else np.zeros(0)
        return float(values[link + 1]) if 0 <= link + 1 < len(values) else math.nan

    def given(self, names: tuple[str, ...], body: int, link: int, at: Moment) -> list[float]:
        """Return what `changeDynamics` last gave a part up to a moment; empty if it never did.

        PyBullet takes these arguments together, and ignores them if one is missing or below 0.
        """
        if body in self.seen.bodies:
            came = order(self.appearance(body, at).at)
            last = bisect_right(self._moments["given"][body], at)
            for each in reversed(self.seen.by_body[body].given[:last]):
                if order(each.at) >= came and each.values.get("linkIndex") == link:
                    values = [float(np.ravel(each.values.get(name, -1))[0]) for name in names]
                    if min(values) >= 0:
                        return values
        return []

    def appearance(self, body: int, at: Moment) -> Appearance:
        """Return when a body was last added, up to a moment: it may be loaded several times."""
        last = bisect_right(self._moments["came"][body], at) - 1
        return self.seen.by_body[body].came[max(last, 0)]

    @cached_property
    def _moments(self) -> dict[str, dict[int, list[Moment]]]:
        """The moments of what was seen of each body, by kind."""
        return {
            kind: {
                number: [order(event.at) for event in getattr(record, kind)]
                for number, record in self.seen.by_body.items()
            }
            for kind in ("came", "dynamics", "given", "puts")
        }

    def mass_kg(self, body: int, link: int, at: Moment) -> float:
        """Return the mass of a part at a moment; 0 where it is unknown."""
        return float(np.nan_to_num(self.reported("mass_kg", body, link, at)))

    def extents_m(self, body: int, link: int, at: Moment) -> Float64 | None:
        """Return the edges of the box around a part along its own axes, (3,); None if unknown."""
        if not self.collides(body, link, at):
            return None
        came = self.appearance(body, at)
        key = body, link, order(came.at)
        if key not in self._extents:
            self._extents[key] = edges_of(came.body, link, self._orientation(came, link))
        return self._extents[key]

    @cached_property
    def _extents(self) -> dict[tuple[int, int, Moment], Float64 | None]:
        """Those that were asked for, by part and by when its body appeared."""
        return {}

    def collides(self, body: int, link: int, at: Moment) -> bool:
        """Whether a part has a shape that can touch another."""
        known = body in self.seen.bodies
        return known and bool(box_m(self.appearance(body, at).body, link).any())

    def filtered(self, one: Body, other: Body) -> bool:
        """Whether two bodies may not collide: neither has mass, or a call has said so."""
        if not (one.soft or other.soft or self.heavy & {one.number, other.number}):
            return True
        pair = {one.engine_id, other.engine_id}
        return any(client == one.client and named <= pair for client, named in self._filters)

    @cached_property
    def _filters(self) -> list[tuple[int, set[int]]]:
        """Client, and the bodies that each call names which decides what collides."""
        filters = []
        for call in self.seen.calls:
            if call.function.startswith("setCollisionFilter"):
                first = re.match(r"(?:-?\d+(?:, |$))*", call.arguments)
                numbers = first[0].split(", ") if first else []
                numbers = numbers[: 2 if call.function.endswith("Pair") else 1]
                numbers += re.findall(r"\bbodyUniqueId[AB]?=(-?\d+)", call.arguments)
                filters.append((call.client, {int(number) for number in numbers if number}))
        return filters

    @cached_property
    def heavy(self) -> frozenset[int]:
        """Bodies that ever had mass: those without any do not collide with each other."""
        reports = self.seen.dynamics
        return frozenset(each.body.number for each in reports if each.reported["mass_kg"].any())

    def may_meet(self, body: Body) -> bool:
        """Whether there is a shape that a body collides with, as far as is known."""
        return any(
            other.client == body.client
            and other.number != body.number
            and not self.filtered(body, other)
            and (
                other.soft
                or other.hides_links
                or any(box_m(other, link).any() for link in range(BASE, len(other.links) - 1))
            )
            for other in self.seen.bodies.values()
        )

    def ball_m(self, came: Appearance) -> Float64:
        """Return a ball around a base's shape, (4,): centre and radius; nan where unknown.

        The centre is that of the box around it, from the centre of mass, in the base's axes.
        """
        pose = self._pose(came, BASE)
        if pose is None or not box_m(came.body, BASE).any():
            return np.full(4, math.nan)
        low_m, high_m = np.reshape(came.body.bounds_m[:6], (2, 3))
        position_m, orientation = (np.array([each]) for each in pose)
        (offset_m,) = rotate_inverse(orientation, (low_m + high_m) / 2 - position_m)
        return np.array([*offset_m, np.linalg.norm(high_m - low_m) / 2])

    def _orientation(self, came: Appearance, link: int) -> Sequence[float] | None:
        """Return the orientation of a part where its body appeared; None if unknown."""
        pose = self._pose(came, link)
        return None if pose is None else pose[1]

    def _pose(self, came: Appearance, link: int) -> Pose | None:
        """Return where a part was, and its orientation, as its body appeared; None if unknown."""
        number, at = came.body.number, order(came.at)
        puts = self.seen.by_body[number].puts
        which = bisect_left(self._moments["puts"][number], at)
        if which < len(puts) and order(puts[which].at) == at:
            (state,) = (placed := self.seen.placed(puts[which]))[placed["link"] == link]
            return tuple(state["position_m"]), tuple(state["orientation"])
        # What time moves is in the first sample of all instead.
        rows = self.seen.parts.get((number, link))
        if rows is None or came.sampled:
            return None
        row = rows.filter(pl.col("step") == came.at.step)
        if not len(row):
            return None
        motion = motion_of(row)
        return tuple(motion.position_m[0]), tuple(motion.orientation[0])

    def label(self, body: int, link: int = -1) -> str:
        """Return the name of a part: the body, and the link where it is not the base."""
        known = self.seen.bodies.get(body)
        if known is None:
            return Message("a link that PyBullet does not show")
        if link < 0:
            return known.label
        return Message("{body}, link {link}", body=known.label, link=known.links[link + 1])

    def site(
        self, functions: Iterable[str], at: At, body: Body | None = None, argument: str = ""
    ) -> str | None:
        """Return file and line of the last call of any of some functions up to a moment.

        With a body, only calls that name it or change all; with an argument, only calls that give
        it.
        """
        names = frozenset(functions)
        for call in reversed(self.seen.calls):
            if (call.at.step, call.at.call) > (at.step, at.call) or call.function not in names:
                continue
            if argument not in call.arguments:
                continue
            if body is None or (call.client == body.client and is_of(call, body)):
                return f"{call.file}:{call.line}"
        return None

    def finding(
        self, code: str, message: Message, *, body: int | None = None, step: int | None = None,
        site: str | None = None,
    ) -> ScriptFinding:  # fmt: skip
        """Return a finding; the message of one on a body begins with its label."""
        if site:
            message = Message("{finding} ({site})", finding=message, site=site)
        name = None if body is None else self.label(body)
        return ScriptFinding(code, message, name, step, site)


def first_steps(record: OfBody) -> set[int]:
    """Return the steps that began with a body where it appeared or a call had put it."""
    came = {appearance.at.step + 1 for appearance in record.came}
    return came | {put.at.step + 1 for put in record.puts}


def start_of(step: int) -> Moment:
    """Return when a step began, with all that was called before it."""
    return step - 1, math.inf


def is_of(call: Call, body: Body) -> bool:
    """Whether a call names a body's id, or changes all."""
    named = re.search(r"\b(?:bodyUniqueId|objectUniqueId|bodyIndex)=(-?\d+)\b", call.arguments)
    named = named or re.match(r"(-?\d+)\b", call.arguments)
    return call.function in OF_ALL or (named is not None and int(named[1]) == body.engine_id)

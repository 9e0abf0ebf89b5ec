"""What the findings on a script's recording are drawn from."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.general.contacts import Contacts
from pipeline.analysis.script.judged import Judged
from pipeline.analysis.script.results import BodyAnalysis, ScriptFinding
from pipeline.analysis.script.times import Times
from pipeline.analysis.script.tracks import order
from pipeline.messages import Message
from pipeline.seen import Appearance, At, Body, Call, Dynamics, Seen

Float64 = NDArray[np.float64]
Moment = tuple[int, float]
"""Steps and calls before it: the sort key of an event (`order`)."""

SLABS = ("box", "plane")
"""Shapes that fill the box around them where they are not turned."""
MARGIN_M = 1e-3
"""Margin of Bullet's box around a body, on each side."""
OF_ALL = ("restoreState",)
"""Calls that change every body."""


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
        return frozenset(
            number
            for number, record in self.seen.by_body.items()
            if any(put.at.step > record.came[0].at.step for put in record.puts)
        )

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
    def slabs(self) -> list[tuple[Body, Float64, Float64]]:
        """Fixed boxes and planes, with their corners: nothing passes through them."""
        slabs = []
        for body in self.seen.bodies.values():
            fixed = body.number not in self.judged and body.number not in self.set_bodies
            if fixed and _is_slab(body):
                slabs.append((body, np.array(body.bounds_m[:3]), np.array(body.bounds_m[3:])))
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
            for kind in ("came", "dynamics", "given")
        }

    def mass_kg(self, body: int, link: int, at: Moment) -> float:
        """Return the mass of a part at a moment; 0 where it is unknown."""
        return float(np.nan_to_num(self.reported("mass_kg", body, link, at)))

    def extents_m(self, body: int, link: int) -> Float64 | None:
        """Return the edges of the box around a part as loaded, (3,); None without a size."""
        known = self.seen.bodies.get(body)
        bounds = () if known is None else known.bounds_m[6 * (link + 1) : 6 * (link + 2)]
        if len(bounds) != 6:
            return None
        edges = np.subtract(bounds[3:], bounds[:3])
        return edges if (edges > 0).all() else None

    def label(self, body: int, link: int = -1) -> str:
        """Return the name of a part: the body, and the link where it is not the base."""
        known = self.seen.bodies.get(body)
        if known is None:
            return Message("body {number}", number=body)
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
            if body is None or (call.client == body.client and _is_of(call, body)):
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


def start_of(step: int) -> Moment:
    """Return when a step began, with all that was called before it."""
    return step - 1, math.inf


def _is_slab(body: Body) -> bool:
    """Whether a body fills the box around it: it is one shape, and not turned."""
    if len(body.shapes) != 1 or len(body.bounds_m) != 6 or body.shapes[0].kind not in SLABS:
        return False
    (shape,) = body.shapes
    wider_m = np.subtract(body.bounds_m[3:], body.bounds_m[:3]) - shape.size_m[:3]
    return shape.kind == "plane" or bool((np.abs(wider_m) <= 2 * MARGIN_M * (1 + 1e-6)).all())


def _is_of(call: Call, body: Body) -> bool:
    named = re.search(r"\b(?:bodyUniqueId|objectUniqueId|bodyIndex)=(-?\d+)\b", call.arguments)
    named = named or re.match(r"(-?\d+)\b", call.arguments)
    return call.function in OF_ALL or (named is not None and int(named[1]) == body.engine_id)

"""Everything that was observed of simulations, in order, as analysis asks for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePath
from typing import Protocol

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.errors import ScenarioError
from drop_physics.seen.calls import Call, Constraint, Given, Meanings, Motor, Push
from drop_physics.seen.events import (
    Appearance,
    Body,
    Dynamics,
    Put,
    Settings,
    Solver,
    Surface,
)
from drop_physics.seen.poses import (
    COLUMNS,
    MOTION_COLUMNS,
    inertial_frames,
    links_of,
    rows_of,
    tree_of,
)
from drop_physics.states import BASE, STATE, Joints, Rows

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

PIECE = 1 << 15
"""Steps in a piece."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Everything sampled of consecutive steps, of all simulations, and the calls between them."""

    first: int
    """The first of these steps."""
    end: int
    """One more than the last."""
    bases: pl.DataFrame
    """One row per step and base that can move, in step order: `step`, `body` and its state."""
    joints: Mapping[int, Joints]
    """By body number."""
    forces: Mapping[tuple[int, int], tuple[Int64, Float64]]
    """Of each constraint, by client and the engine's id: steps, and its forces then."""
    contacts: pl.DataFrame
    """One row per contact point, in step order."""
    calls: list[Call]


class Sampled(Protocol):
    """Where the samples are: a recording that is read piece by piece."""

    @property
    def first(self) -> int:
        """The first step of which there is anything; 0 if there is none."""

    @property
    def last(self) -> int:
        """The last step of which there is anything; -1 if there is none."""

    def piece(self, first: int, end: int) -> Piece:
        """Return what was sampled of the steps from `first` to before `end`."""


@dataclass(frozen=True)
class Seen:
    """Everything observed of simulations; lists in the order of events."""

    bodies: Mapping[int, Body]
    """By number, each as last seen."""
    appearances: list[Appearance]
    surfaces: list[Surface]
    """Of meshes that are held as their hulls, where they are hollow."""
    dynamics: list[Dynamics]
    settings: list[Settings]
    solvers: list[Solver]
    """One for each simulation and iteration limit whose solver stopped early."""
    puts: list[Put]
    samples: Mapping[int, int]
    """Number of samples of each simulation, by client; empty if unknown."""
    sampled: Sampled
    real_time: bool
    """Whether the script asked for real-time simulation, and was stepped by a clock instead."""
    unseeded: tuple[str, ...]
    """Where it drew unseeded random numbers."""
    machine: str
    """Kind of processor; empty if unknown."""

    def pieces(self, steps: int = PIECE) -> Iterator[Piece]:
        """Yield what was sampled, so many steps at a time."""
        for first in range(self.sampled.first, self.sampled.last + 1, steps):
            yield self.sampled.piece(first, first + steps)

    @cached_property
    def _whole(self) -> Piece:
        return self.sampled.piece(self.sampled.first, self.sampled.last + 1)

    @property
    def bases(self) -> pl.DataFrame:
        """One row per step and base that can move, in step order: `step`, `body` and its state."""
        return self._whole.bases

    @property
    def joints(self) -> Mapping[int, Joints]:
        """Of all steps, by body number."""
        return self._whole.joints

    @property
    def contacts(self) -> pl.DataFrame:
        """One row per contact point, in step order."""
        return self._whole.contacts

    @cached_property
    def calls(self) -> list[Call]:
        """Everything that the script did, in order."""
        return [call for piece in self.pieces() for call in piece.calls]

    @cached_property
    def _meanings(self) -> Meanings:
        return Meanings(self.calls, self.appearances)

    @cached_property
    def pushes(self) -> list[Push]:
        """The forces and torques from outside."""
        return [*self._meanings.pushes()]

    @cached_property
    def motors(self) -> list[Motor]:
        """How joints were driven, whenever that changed."""
        return [*self._meanings.motors()]

    @cached_property
    def given(self) -> list[Given]:
        """What calls set of bodies."""
        return [*self._meanings.given()]

    @cached_property
    def constraints(self) -> list[Constraint]:
        """What was connected, and released."""
        return [*self._meanings.constraints()]

    @cached_property
    def parts(self) -> dict[tuple[int, int], pl.DataFrame]:
        """The states of each part that can move, by body and link."""
        parts: dict[tuple[int, int], list[pl.DataFrame]] = {}
        for piece in self.pieces():  # contacts of all steps would take four times as much
            for part, states in self.parts_of(piece).items():
                parts.setdefault(part, []).append(states)
        return {part: pl.concat(parts[part]) for part in sorted(parts)}

    def parts_of(self, piece: Piece) -> dict[tuple[int, int], pl.DataFrame]:
        """Return the states of each part that can move in a piece, by body and link."""
        bases = piece.bases.partition_by("body", as_dict=True, maintain_order=True)
        parts = {}
        for number, body in self.bodies.items():
            base = bases.get((number,))
            joints = piece.joints.get(number)
            if base is None and joints is None:
                continue
            steps = joints.steps if joints is not None else base["step"].to_numpy()  # type: ignore[index]
            if len(body.links) == 1 and base is not None:
                parts[number, BASE] = base.with_columns(pl.lit(BASE, pl.Int64).alias("link"))
                continue
            states = rows_of(number, steps, self.motions(body, steps, base, joints))
            by_link = states.reshape(len(steps), -1)
            for link in body.moving:
                parts[number, link] = table_of(by_link[:, link + 1])
        return parts

    def motions(
        self, body: Body, steps: Int64, base: pl.DataFrame | None, joints: Joints | None
    ) -> Float64:
        """Return the motions of base and links, shape (n, links, 13)."""
        # Without `by_body`, which reads all calls.
        first = next(each for each in self.dynamics if each.body.number == body.number)
        tree = tree_of(body.joints, inertial_frames(first.reported))
        sampled = np.empty(0, np.int64) if base is None else base["step"].to_numpy()
        motion = np.zeros((len(steps), 13))
        puts = [put for put in self.puts if put.body.number == body.number]
        if puts and len(sampled) < len(steps):  # a base that only calls move, at least at first
            which = np.searchsorted([put.at.step for put in puts], steps, side="right") - 1
            motion = np.array([put.base for put in puts])[np.maximum(which, 0)]
        if base is not None:
            within = np.isin(sampled, steps)
            rows = np.searchsorted(steps, sampled[within])
            motion[rows] = base.select(MOTION_COLUMNS).to_numpy()[within]
        if joints is not None and len(joints.steps) != len(steps):
            joints = joints.at(np.isin(joints.steps, steps))
        return links_of(tree, motion, joints)

    def placed(self, put: Put) -> Rows:
        """Return the states of base and links that calls gave a body."""
        reported = self.by_body[put.body.number].dynamics[0].reported
        tree = tree_of(put.body.joints, inertial_frames(reported))
        motions = links_of(tree, put.base[None], put.joints)
        return rows_of(put.body.number, np.array([put.at.step]), motions)

    @cached_property
    def states(self) -> pl.DataFrame:
        """One row per step and part, in the order of body, link and step."""
        return joined(self.parts)

    @cached_property
    def by_body(self) -> dict[int, OfBody]:
        """What was seen of each body, by its number."""
        by_body = {number: OfBody() for number in self.bodies}
        for appearance in self.appearances:
            if appearance.came:
                by_body[appearance.body.number].came.append(appearance)
        for dynamics in self.dynamics:
            by_body[dynamics.body.number].dynamics.append(dynamics)
        for given in self.given:
            by_body[given.body.number].given.append(given)
        for push in self.pushes:
            by_body[push.body.number].pushes.append(push)
        for put in self.puts:
            by_body[put.body.number].puts.append(put)
        for constraint in self.constraints:
            for number in constraint.bodies:
                by_body[number].constraints.append(constraint)
        return by_body


def table_of(rows: Rows) -> pl.DataFrame:
    """Return rows of dtype `STATE` as a table: step, body, link, and the columns of a state."""
    columns = {name: rows[name].copy() for name in ("step", "body", "link")}
    for name, names in COLUMNS.items():
        columns |= {each: rows[name][:, number].copy() for number, each in enumerate(names)}
    return pl.DataFrame(columns)


def joined(parts: Mapping[tuple[int, int], pl.DataFrame]) -> pl.DataFrame:
    """Return the states of all parts as one table, in the order of body, link and step."""
    ordered = [rows for _, rows in sorted(parts.items())]
    whole = pl.concat([table_of(np.empty(0, STATE)), *ordered], how="diagonal")
    return whole.select("step", "body", "link", *MOTION_COLUMNS)


@dataclass(frozen=True)
class OfBody:
    """What was seen of one body; lists in the order of events."""

    came: list[Appearance] = field(default_factory=list)
    """When it was added; several if a script loads it repeatedly."""
    dynamics: list[Dynamics] = field(default_factory=list)
    given: list[Given] = field(default_factory=list)
    pushes: list[Push] = field(default_factory=list)
    puts: list[Put] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    """Those that were created."""

    @property
    def moves(self) -> list[Put]:
        """Where calls moved it after it was added: that is reported as a move, too."""
        came = {(each.at.step, each.at.call) for each in self.came}
        return [put for put in self.puts if (put.at.step, put.at.call) not in came]


def body_named(bodies: Iterable[Body], which: str) -> Body:
    """Return the only body of a number, label or name, with or without the suffix of its file.

    Raises
    ------
    ScenarioError
        If there is none, or several have the name.
    """
    candidates = list(bodies)
    matches = [
        body for body in candidates
        if which in (str(body.number), body.label, body.name, PurePath(body.name).stem)
    ]  # fmt: skip
    if len(matches) == 1:
        return matches[0]
    shown = matches or candidates
    listed = ", ".join(f"{body.number} ({body.name})" for body in shown[:10])
    listed += " …" if len(shown) > 10 else ""
    if matches:
        raise ScenarioError(
            "--body must be a body of the recording, got {which!r}, the name of several; "
            "use a number: {listed}",
            which=which,
            listed=listed,
        )
    raise ScenarioError(
        "--body must be a body of the recording, got {which!r}, which is none; it has: {listed}",
        which=which,
        listed=listed,
    )

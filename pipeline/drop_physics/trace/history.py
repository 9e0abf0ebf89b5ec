"""Everything that was observed of simulations, in order, as analysis asks for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePath
from typing import Protocol

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.errors import ScenarioError
from drop_physics.trace.events import Appearance, Body, Dynamics, Put, Settings, Solver, Surface
from drop_physics.trace.log import Log
from drop_physics.trace.poses import (
    COLUMNS,
    MOTION_COLUMNS,
    inertial_frames,
    links_of,
    rows_of,
    tree_of,
)
from drop_physics.trace.states import BASE, STATE, Joints, Rows

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

PIECE = 1 << 13
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
    calls: Log


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

    @property
    def calls(self) -> Log:
        """Everything that the script did."""
        return self._whole.calls

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

    @cached_property
    def states(self) -> pl.DataFrame:
        """One row per step and part, in the order of body, link and step."""
        return joined(self.parts)


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


def body_named(bodies: Iterable[Body], which: str) -> Body:
    """Return the only body of a number, label or name, with or without the suffix of its file.

    Raises
    ------
    ScenarioError
        If there is none, or several have the name.
    """
    candidates = list(bodies)
    matches = [
        body
        for body in candidates
        if which in (str(body.number), body.label, body.name, PurePath(body.name).stem)
    ]
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

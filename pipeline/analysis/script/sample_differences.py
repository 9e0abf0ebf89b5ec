"""The samples of two simulations compared: states, joints, contact points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.general.differences import off, states_off
from pipeline.analysis.script.difference import FIRST, LED, Dated, Difference, When
from pipeline.laws.rotations import same_way
from pipeline.seen import Body, Joints, Seen

Float64 = NDArray[np.float64]

PART = ("body", "link", "step")
POSITION = ("x_m", "y_m", "z_m")
COLUMNS = (
    *POSITION, "qx", "qy", "qz", "qw", "vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s",
    "wz_rad_s",
)  # fmt: skip
UNKNOWN_LENGTH_M = 1.0
"""Of a part without a shape: an angle may then be off by as many radians as metres are allowed."""


@dataclass(frozen=True)
class Paired:
    """The samples of the bodies that two simulations share."""

    bodies: Mapping[int, Body]
    """By number."""
    rows: pl.DataFrame
    """`body`, `link` and `step` of those that both have, in this order."""
    mine: Float64
    """Of the checked recording, shape (rows, 13): `COLUMNS`."""
    golden: Float64
    lacking: pl.DataFrame
    """`body`, `link` and `step` of the samples that only one has, and `there`: whether that is the
    checked one."""
    fresh: frozenset[tuple[int, int]]
    """Number and step of bodies whose first sample was taken after they appeared."""

    @property
    def distance_m(self) -> Float64:
        """How far apart the parts are, shape (rows,); nan where a position is."""
        distance_m: Float64 = np.linalg.norm(self.mine[:, :3] - self.golden[:, :3], axis=1)
        return distance_m

    def when(self, number: int, step: int) -> When:
        """Return when a sample of a body was taken."""
        return When(step, FIRST if step == 0 or (number, step) in self.fresh else LED)


def paired(run: Seen, golden: Seen) -> Paired:
    """Return the samples of two simulations, those of one part and step in one row."""
    labels = [{body.label: body for body in seen.bodies.values()} for seen in (run, golden)]
    bodies = {body.number: body for label, body in labels[0].items() if label in labels[1]}
    mine, theirs = (
        seen.states.filter(pl.col("body").is_in(list(bodies))) for seen in (run, golden)
    )
    lacking = pl.concat(
        side.join(other, on=PART, how="anti").select(*PART, there=pl.lit(there))
        for side, other, there in ((mine, theirs, True), (theirs, mine, False))
    )
    # A body that came after a picture was taken has no sample of where it began.
    came = [_came(run), _came(golden)]
    began = pl.DataFrame(
        [
            (body.number, step)
            for label, step in came[0] & came[1]
            for body in bodies.values()
            if body.label == label
        ],
        schema={"body": pl.Int64, "step": pl.Int64},
        orient="row",
    )
    lacking = lacking.join(began, on=("body", "step"), how="anti")
    if not mine.select(PART).equals(theirs.select(PART)):
        mine, theirs = (
            side.join(other, on=PART, how="semi").sort(PART)
            for side, other in ((mine, theirs), (theirs, mine))
        )
    fresh = frozenset(
        (each.body.number, each.at.step)
        for each in run.appearances
        if each.came and not each.sampled
    )
    values, others = (side.select(COLUMNS).to_numpy() for side in (mine, theirs))
    return Paired(bodies, mine.select(PART), values, others, lacking, fresh)


def _came(seen: Seen) -> set[tuple[str, int]]:
    """Return the labels of the bodies that came, and the steps before."""
    return {(each.body.label, each.at.step) for each in seen.appearances if each.came}


def first_state(of: Paired, tolerated: Float64 | None = None) -> Dated | None:
    """Return the first number that differs by more than allowed, or sample that one lacks.

    Parameters
    ----------
    of
        The samples.
    tolerated
        Allowed difference of each number, shape (rows, 13); None for none.
    """
    dated = []
    if len(of.lacking):
        body, link, step, there = of.lacking.sort("step", "body", "link").row(0)
        values = float(there), float(not there)
        dated.append(_dated(of, step, body, link, "there", *values))
    golden = of.golden
    if tolerated is not None:  # then a quaternion of the other sign is the same orientation
        turns = slice(COLUMNS.index("qx"), COLUMNS.index("qw") + 1)
        golden = golden.copy()
        golden[:, turns] = same_way(golden[:, turns], of.mine[:, turns])
    differ = off(of.mine, golden) if tolerated is None else states_off(of.mine, golden, tolerated)
    rows = np.flatnonzero(differ.any(axis=1))
    if len(rows):
        row = rows[np.argmin(of.rows["step"].to_numpy()[rows])]
        column = int(np.argmax(differ[row]))
        body, link, step = of.rows.row(int(row))
        values = float(of.mine[row, column]), float(golden[row, column])
        dated.append(_dated(of, step, body, link, COLUMNS[column], *values))
    return min(dated, key=lambda each: each[0], default=None)


def _dated(
    of: Paired, step: int, number: int, link: int, column: str, mine: float, golden: float
) -> Dated:
    difference = Difference(step, of.bodies[number].label, link, column, mine, golden)
    return of.when(number, step), difference


def allowed(of: Paired, golden: Seen, tolerance_m: float) -> Float64:
    """Return what a tolerance allows in each number of the states, shape (rows, 13).

    A velocity may be off by what moves the body that far in one step, an angle by what moves the
    surface that far, half the diagonal of the part's box away.
    """
    of_client = {each.client: each.values["fixedTimeStep"] for each in golden.settings}
    steps_s = {body.label: of_client[body.client] for body in golden.bodies.values()}
    parts = of.rows.select("body", "link")
    allowed = np.empty((len(parts), len(COLUMNS)))
    for (number, link), rows in (
        parts.with_row_index().partition_by("body", "link", as_dict=True).items()
    ):
        body = of.bodies[int(number)]
        step_s, length_m = float(np.max(steps_s[body.label])), _length_m(body, int(link))
        # A quaternion has half the angle.
        per_metre = np.repeat(
            [1.0, 1 / (2 * length_m), 1 / step_s, 1 / (length_m * step_s)], (3, 4, 3, 3)
        )
        allowed[rows["index"].to_numpy()] = tolerance_m * per_metre
    return allowed


def _length_m(body: Body, link: int) -> float:
    corners = np.reshape(body.bounds_m, (-1, 2, 3))
    if link + 1 >= len(corners):
        return UNKNOWN_LENGTH_M
    length_m = float(np.linalg.norm(corners[link + 1, 1] - corners[link + 1, 0])) / 2
    return length_m if np.isfinite(length_m) and length_m > 0 else UNKNOWN_LENGTH_M


def first_end(run: Seen, golden: Seen) -> Dated | None:
    """Return where a simulation ends before the other, though nothing may move there.

    Ones without bodies do not count.
    """
    dated = []
    for client in {body.client for body in run.bodies.values()}:
        mine, other = run.samples.get(client), golden.samples.get(client)
        if mine is not None and other is not None and mine != other:
            step = min(mine, other)
            there = float(mine > other), float(other > mine)
            dated.append((When(step, LED), Difference(step, None, None, "there", *there)))
    return min(dated, key=lambda each: each[0], default=None)


# -- joints ---------------------------------------------------------------------------------------


def first_joint(of: Paired, run: Seen, golden: Seen) -> Dated | None:
    """Return the first number of joints that differs, in the steps that both have."""
    dated = (_first_of_body(of, number, run, golden) for number in of.bodies)
    return min(filter(None, dated), key=lambda each: each[0], default=None)


def _first_of_body(of: Paired, number: int, run: Seen, golden: Seen) -> Dated | None:
    mine, theirs = (seen.joints.get(number) for seen in (run, golden))
    columns = [_joint_columns(seen.bodies[number]) for seen in (run, golden)]
    if mine is None or theirs is None or columns[0] != columns[1]:
        return None
    steps, rows, others = np.intersect1d(mine.steps, theirs.steps, return_indices=True)
    x, y = _numbers(mine)[rows], _numbers(theirs)[others]
    differ = off(x, y)
    wrong = np.flatnonzero(differ.any(axis=1))
    if not len(wrong):
        return None
    row, column = int(wrong[0]), int(np.argmax(differ[wrong[0]]))
    name, link = columns[0][column]
    return _dated(
        of, int(steps[row]), number, link, name, float(x[row, column]), float(y[row, column])
    )


def _numbers(joints: Joints) -> Float64:
    return np.hstack((joints.position, joints.velocity, joints.torque))


def _joint_columns(body: Body) -> list[tuple[str, int]]:
    """Return name and link of each number of a body's joints."""
    return [
        (f"joint_{name}", joint.link)
        for number, name in enumerate(("position", "velocity", "torque"))
        for joint in body.joints
        for _ in range(joint.widths[number])
    ]


# -- contact points -------------------------------------------------------------------------------


def first_contact(run: Seen, golden: Seen) -> Dated | None:
    """Return the first contact point that differs, or the first step with more of them."""
    mine, theirs = _points(run), _points(golden)
    names = [name for name in theirs.columns if name != "step"]
    both = min(len(mine), len(theirs))
    steps, golden_steps = (table["step"].to_numpy() for table in (mine, theirs))
    x, y = (table.head(both).select(names).to_numpy() for table in (mine, theirs))
    differ = off(x, y)
    wrong = np.flatnonzero(differ.any(axis=1) | (steps[:both] != golden_steps[:both]))
    if not len(wrong) and len(mine) == len(theirs):
        return None
    row = int(wrong[0]) if len(wrong) else both
    step = int(min(each[row] for each in (steps, golden_steps) if row < len(each)))
    counts = [int((each == step).sum()) for each in (steps, golden_steps)]
    side, table = (run, mine) if row < len(mine) and steps[row] == step else (golden, theirs)
    # Of links of btRigidBodies PyBullet does not say whose they are.
    both_sides = (table.select(f"body_{which}", f"link_{which}").row(row) for which in "ab")
    known = ((side.bodies[body].label, link) for body, link in both_sides if body in side.bodies)
    body, link = next(known, (None, None))
    if counts[0] != counts[1]:
        difference = Difference(step, body, link, "contact_points", *map(float, counts))
    else:
        column = int(np.argmax(differ[row]))
        values = float(x[row, column]), float(y[row, column])
        difference = Difference(step, body, link, f"contact_{names[column]}", *values)
    return When(step, LED if step else FIRST), difference


def _points(seen: Seen) -> pl.DataFrame:
    """Return the contact points in the order of step and client; each client has its own steps."""
    numbers = {number: body.client for number, body in seen.bodies.items()}
    client = pl.col("body_a").replace_strict(numbers, default=0, return_dtype=pl.Int64)
    return seen.contacts.sort("step", client, maintain_order=True)

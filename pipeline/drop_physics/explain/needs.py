"""Computes the motor torques that would hold a body in its present pose.

The torques balance gravity, forces that calls apply, and loads that the body carries by constraints
or contacts. Supports that the body leans on, such as a table or a stop, are ignored. If a load has
further supports, or is pressed from several sides, the torque of a joint is undetermined.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.causes import TENDON_LIMIT
from drop_physics.explain.joined import GEAR, POINT
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.steps import Steps
from drop_physics.physics.dynamics import gravity
from drop_physics.physics.impulses import impulses_of
from drop_physics.physics.kinematics import Kinematics, generalised_at_points, kinematics
from drop_physics.physics.tree import BASE, States, Tree
from drop_physics.trace.events import Body
from drop_physics.trace.states import between

Place = tuple[int, int]
"""A body id, and a link of the body."""

PASSIVE = "spring", "gravity compensation", "tendon "
"""Prefixes of causes whose force depends only on the pose, other than those in `HOLDS`."""
HOLDS = "constraints", TENDON_LIMIT
"""Prefixes of causes whose force reacts to other forces."""
ACTS = 1e-9
"""A force below this share of the largest counts as zero."""


@dataclass(eq=False)
class Load:
    """A group of connected movable bodies that a robot or other body carries."""

    bodies: set[int]
    anchored: bool = False
    """Whether anything other than the body also supports the load."""
    links: set[int] = field(default_factory=set)
    """The links of the carrying body that touch the load, or are joined to it."""
    joined: dict[int, int] = field(default_factory=dict)
    """The links of the carrying body to which constraints join the load, with the constraint's
    kind."""


@dataclass(frozen=True, eq=False)
class PoseSupport:
    """The static torques that hold a pose, by cause; shape (joint_rates,) unless noted."""

    needs: Float64
    """Static torques [N] or [N m]; nan where undetermined."""
    contacts: Mapping[int, Float64]
    """Torques due to contacts with each other body, by body id."""
    constraints: Float64
    stops: Float64
    _steps: Steps
    _row: int
    _passive: bool
    """Whether springs or similar causes act, whose force would differ in another pose."""
    _loads: tuple[Load, ...]
    _masses: Mapping[int, tuple[float, Float64]]
    """Total mass and centre of mass of each load, by index in `_loads`."""

    def from_one_side(self, body: int, joint_rate: int) -> Load | None:
        """Return the load that contains a body, if only links moved by the joint carry it."""
        tree = self._steps.law.tree
        moved = _beyond(tree, tree.first_rate + joint_rate)
        its = (load for load in self._loads if body in load.bodies and load.links <= moved)
        return next(its, None)

    def weighs(self, joint_rate: int) -> float | None:
        """Return the torque that a joint needs to carry the weight of the links that it moves.

        This includes the weight of bodies that touch these links. None if anything else bears part
        of the weight, whether at rest or trembling.
        """
        tree, row = self._steps.law.tree, np.array([self._row])
        moved = _beyond(tree, tree.first_rate + joint_rate)
        loads = [(n, load) for n, load in enumerate(self._loads) if load.links & moved]
        alone = all(load.links <= moved and n in self._masses for n, load in loads)
        if not (tree.fixed and alone) or self.constraints[joint_rate] != 0:
            return None
        kin = kinematics(tree, _still(self._steps.after.at(row)))
        pull = self._steps.reported.gravity_m_s2[row]
        acting = gravity(kin, pull)[0]
        for number, load in loads:
            mass, centre = self._masses[number]
            acting = acting + _pulled(kin, min(load.links), mass * pull, centre[None])[0]
        return -float(acting[tree.first_rate + joint_rate])

    def at(self, positions: Float64) -> Float64:
        """Return the holding torques at other joint positions, shape (joint_coordinates,)."""
        return np.asarray(self.along(positions[None])[0])

    def along(self, positions: Float64) -> Float64:
        """Return the holding torques in several poses, with the loads attached.

        `positions` have the shape (n, joint_coordinates), the torques (n, joint_rates).
        """
        tree, row = self._steps.law.tree, np.array([self._row])
        state = _still(self._steps.after.at(row))
        there = state.at(np.zeros(len(positions), np.int64))
        kin, here = kinematics(tree, replace(there, joints=positions)), kinematics(tree, state)
        pull = np.repeat(self._steps.reported.gravity_m_s2[row], len(positions), axis=0)
        acting = gravity(kin, pull)
        unknown = np.zeros(tree.size, np.bool_)
        for number, load in enumerate(self._loads):
            rows = _rows_moved(tree, load.links)
            if number not in self._masses or len(load.links) > 1 or not load.joined:
                unknown |= rows
                continue
            mass, centre = self._masses[number]
            (link,) = load.links
            if load.joined[link] == POINT:  # it hangs: below its pivot, wherever that is
                held = self._steps.reported.constraints
                centre = held.point_m[(held.step == self._row) & (held.link == link)].mean(axis=0)
            local = (centre - here.position_m(link)[0]) @ here.matrix(link)[0]
            acting = acting + _pulled(kin, link, mass * pull, kin.point_m(link, local))
        acting = np.where(unknown | self._passive, np.nan, acting)
        return np.asarray(-acting[:, tree.first_rate :])


def holding(
    explained: ExplainedPiece,
    bodies: Mapping[int, Body],
    steps: Steps,
    row: int,
    *,
    number: int,
    resting: bool,
) -> PoseSupport:
    """Return the torques that hold a body's pose after a step, by cause.

    Parameters
    ----------
    explained
        The explained chunk that contains the step.
    bodies
        All bodies, by id.
    steps, row
        Steps of the body, and the row of the step.
    number
        The id of the body.
    resting
        Whether the body is at rest: loads are known only then.
    """
    tree, sample = steps.law.tree, int(steps.steps[row])
    contacts, other = _touching(steps, row)
    on_rates = {one: contacts[other == one] for one in np.unique(other).tolist()}
    loads, fixed = _loads(explained, bodies, number, sample)
    kin = kinematics(tree, _still(steps.after.at(np.array([row]))))
    acting = gravity(kin, steps.reported.gravity_m_s2[row : row + 1])[0]
    known = np.full(tree.size, bool(tree.fixed or not fixed))
    constraints = stops = passive = np.zeros(tree.size)
    timestep_s = float(steps.reported.timestep_s[row])
    if steps.covered and steps.closes[row] and timestep_s > 0:
        applied, stops = (steps.terms[name][row] / timestep_s for name in ("applied", "stops"))
        held = {name: term[row] for name, term in steps.terms.items() if name.startswith(HOLDS)}
        constraints = np.sum([*held.values()], axis=0) / timestep_s
        passive = _passive(steps, row) / timestep_s
        acting = acting + applied + constraints + passive
        known &= resting | (applied == 0)
    elif steps.covered or loads or fixed or len(contacts):
        known[:] = False
    for load in loads:
        for one in load.bodies & on_rates.keys():
            acting = acting + on_rates[one].sum(axis=0)
    known &= _alone(tree, loads, on_rates, constraints, resting=resting)
    if steps.reported.geared is not None:
        known[tree.first_rate :] &= steps.reported.geared[row] == 0
    joint = slice(tree.first_rate, None)
    return PoseSupport(
        needs=np.where(known, -acting, np.nan)[joint],
        contacts={one: rate.sum(axis=0)[joint] for one, rate in on_rates.items()},
        constraints=constraints[joint],
        stops=stops[joint],
        _steps=steps,
        _row=row,
        _passive=bool(passive.any()),
        _loads=tuple(loads),
        _masses=_masses(explained, loads, sample),
    )


def _passive(steps: Steps, row: int) -> Float64:
    """Return the impulses of causes that depend on the pose only, such as springs."""
    found = [
        term[row]
        for name, term in steps.terms.items()
        if name.startswith(PASSIVE) and not name.startswith(HOLDS)
    ]
    return np.sum(found, axis=0) if found else np.zeros(steps.law.tree.size)


def _alone(
    tree: Tree,
    loads: Iterable[Load],
    contacts: Mapping[int, Float64],
    constraints: Float64,
    *,
    resting: bool,
) -> Flags:
    """Flag the rates that carry their loads without other supports, shape (size,)."""
    sizes = [np.abs(each).max(initial=0.0) for each in (constraints, *contacts.values())]
    least = ACTS * max(float(max(sizes)), 1e-300)
    alone, pulled = np.ones(tree.size, np.bool_), np.abs(constraints) > least
    held = np.zeros(tree.size, np.bool_)
    for load in loads:
        joined = _rows_moved(tree, load.joined)
        held |= joined
        carried = pulled & joined
        for one in load.bodies & contacts.keys():
            carried |= np.abs(contacts[one]).max(axis=0) > least
        for rate in np.flatnonzero(carried).tolist():
            alone[rate] &= resting and not load.anchored and load.links <= _beyond(tree, rate)
    # What a constraint to the world, or within the body, takes is not one motor's to give.
    return np.asarray(alone & (held | ~pulled))


def _still(state: States) -> States:
    return replace(state, velocity=state.velocity * 0.0)


def _touching(steps: Steps, row: int) -> tuple[Float64, Int64]:
    """Return the generalised force of each contact point in a step, and the other body."""
    contacts, sides = steps.reported.contacts, steps.sides
    first, end = np.searchsorted(contacts.step, (row, row + 1))
    kin = kinematics(steps.law.tree, steps.before.at(np.array([row])))
    forces = impulses_of(kin, contacts.between(row, row + 1), np.ones(1))
    return forces, sides.other_body[first:end]


def _loads(
    explained: ExplainedPiece, bodies: Mapping[int, Body], number: int, sample: int
) -> tuple[list[Load], bool]:
    """Return the loads that a body carries, and whether it touches a fixed body."""
    edges, fixed = _edges(explained, sample), False
    groups: dict[int, Load] = {}
    for (a, link_a), (b, link_b), kind in edges:
        for (body, link), (other, other_link) in (
            ((a, link_a), (b, link_b)),
            ((b, link_b), (a, link_a)),
        ):
            held = not _moves(bodies, other, other_link)
            if body == number:
                fixed |= held and kind is None and other != number
            elif _moves(bodies, body, link):
                load = groups.setdefault(body, Load({body}))
                load.anchored |= held or not bodies[body].base_moves
                if other == number:
                    load.links.add(other_link)
                    if kind is not None:
                        load.joined[other_link] = kind
                elif not held and groups.get(other) is not load:
                    more = groups.get(other, Load({other}))
                    load.bodies |= more.bodies
                    load.anchored |= more.anchored or not bodies[other].base_moves
                    load.links |= more.links
                    load.joined |= more.joined
                    groups |= dict.fromkeys(more.bodies, load)
    loads = {id(load): load for load in groups.values() if load.links}
    return [*loads.values()], fixed


def _edges(explained: ExplainedPiece, sample: int) -> Iterable[tuple[Place, Place, int | None]]:
    """Return the pairs of links that touch or are joined by a constraint in a step."""
    here = between(explained.piece.contacts, sample, sample + 1)
    force = np.abs(here["normal_force_n"])
    names = ["body_a", "link_a", "body_b", "link_b"]
    acts = force > ACTS * force.max(initial=0.0)
    edges: list[tuple[Place, Place, int | None]] = [
        ((a, link_a), (b, link_b), None) for a, link_a, b, link_b in here[names][acts].tolist()
    ]
    for held in explained.constraints.acting(sample):
        if held.kind != GEAR:
            first, second = zip(held.bodies, held.links, strict=True)
            edges.append((first, second, held.kind))
    return edges


def _moves(bodies: Mapping[int, Body], number: int, link: int) -> bool:
    return number in bodies and link in bodies[number].moving


def _beyond(tree: Tree, rate: int) -> set[int]:
    """Return the links that move with a rate; all links for a rate of the base."""
    if rate < tree.first_rate:
        return {BASE, *range(tree.links)}
    joint = next(one for one, at in enumerate(tree.rates) if at.start <= rate < at.stop)
    return {link for link in range(tree.links) if joint in tree.branch(link)}


def _rows_moved(tree: Tree, links: Iterable[int]) -> Flags:
    """Flag the rates that move any of the given links, shape (size,)."""
    rows = np.zeros(tree.size, np.bool_)
    for link in links:
        rows[: tree.first_rate] = True
        for joint in tree.branch(link):
            rows[tree.rates[joint]] = True
    return rows


def _pulled(kin: Kinematics, link: int, force: Float64, point_m: Float64) -> Float64:
    rows = np.arange(len(force))
    links = np.full(len(force), link)
    return generalised_at_points(kin, rows, links, force, point_m, np.zeros_like(force))


def _masses(
    explained: ExplainedPiece, loads: Iterable[Load], sample: int
) -> dict[int, tuple[float, Float64]]:
    """Return the mass and centre of mass of each load, where known, by load index."""
    found = {}
    for number, load in enumerate(loads):
        mass, moment = 0.0, np.zeros(3)
        for body in load.bodies:
            judged = explained.bodies.get(body)
            steps = (
                next((s for s in judged.intervals if sample in s.steps), None) if judged else None
            )
            if steps is None:
                break
            (row,) = np.flatnonzero(steps.steps == sample)
            tree = steps.law.tree
            kin = kinematics(tree, steps.after.at(np.array([row])))
            for link in range(BASE, tree.links):
                mass += tree.masses_kg[link + 1]
                moment += tree.masses_kg[link + 1] * kin.position_m(link)[0]
        else:
            if mass > 0 and not load.anchored:
                found[number] = mass, moment / mass
    return found

"""Forces and torques that calls apply to a body, each acting for one step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drop_physics.arrays import Flags, Int64
from drop_physics.explain.bodies import Record
from drop_physics.explain.body_history import BodyHistory, put_states
from drop_physics.explain.touching import rows_of
from drop_physics.physics.impulses import Forces
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.on_links import pushes
from drop_physics.physics.tree import BASE, Tree
from drop_physics.trace.calls import Push
from drop_physics.trace.events import Put, order


def pushed(
    given: Sequence[Push],
    record: Record,
    tree: Tree,
    history: BodyHistory,
    begins: Int64,
    ends: Int64,
    *,
    refreshed: Int64,
) -> Forces:
    """Return the forces that calls applied to a body in each step.

    PyBullet applies a force at the last computed pose of a link
    (`PhysicsServerCommandProcessor.cpp` 12609, `m_cachedWorldTransform`). For the base this is the
    current pose. For a link it is the pose of one step earlier, unless a call has refreshed the
    poses of this body's links since then: `getLinkState` or `getLinkStates` of any link with
    `computeForwardKinematics=True`, `resetJointState` and its multi-dof form,
    `resetBasePositionAndOrientation`, `resetBaseVelocity`. Poses are also current before the first
    step. Other readings, `performCollisionDetection` and `calculateInverseKinematics` do not
    refresh them. Not every recording contains these calls.

    Parameters
    ----------
    given
        All pushes of this body.
    record, tree
        The recorded data and the tree of the body.
    history
        The states of the body.
    begins, ends
        The index of the state at the start of each step, and the sample after it, shape (n,).
    refreshed
        The number of pushes on links before the link poses were refreshed in each step, shape (n,);
        these pushes act at the pose of one step earlier.
    """
    found, rows = rows_of([each.at.step + 1 for each in given], ends)
    within = np.array([BASE <= given[k].link < tree.links for k in found], np.bool_)
    active, rows = [given[k] for k in found[within]], rows[within]
    if not active:
        return Forces()
    link = np.array([each.link for each in active], np.int64)
    late = (link != BASE) & (_numbers(rows, link) < refreshed[rows])
    used = history.at(begins[rows]).then(_poses(active, record, history, begins[rows], late))
    kin = kinematics(tree, used.states(tree))
    numbers = np.arange(len(active))
    vector, torque = (
        np.array([each.vector for each in active]),
        np.array([[p.torque] for p in active]),
    )
    local = np.array([not each.in_world_axes for each in active])
    point = np.where(torque, 0.0, np.array([each.position_m for each in active]))
    for one in np.unique(link):  # at the centre, so that it has no moment
        turning = np.flatnonzero(torque[:, 0] & ~local & (link == one))
        point[turning] = kin.position_m(int(one))[len(active) + turning]
    acting = pushes(
        kin,
        step=numbers,
        link=link,
        force_n=np.where(torque, 0.0, vector),
        point_m=point,
        torque_n_m=np.where(torque, vector, 0.0),
        in_link_frame=local,
        pose=len(active) + numbers,
    )
    return replace(acting, step=rows)


def _numbers(rows: Int64, link: Int64) -> Int64:
    """Count the pushes on links that precede each push in its step; `rows` ascend."""
    before = np.cumsum(link != BASE) - (link != BASE)
    return np.asarray(before - before[np.searchsorted(rows, rows)])


def _poses(
    active: Sequence[Push], record: Record, history: BodyHistory, begins: Int64, late: Flags
) -> BodyHistory:
    """Return the states of the body at which each push acts.

    This is the state at the time of the call or, for pushes at a pose that was not refreshed
    (`late`), that of one step earlier.
    """
    steps = np.array([each.at.step for each in active], np.int64)
    sampled = np.flatnonzero(history.sampled)
    found = sampled[np.minimum(np.searchsorted(history.steps[sampled], steps), len(sampled) - 1)]
    found = np.where(history.steps[found] == steps, found, begins)
    rows = np.where(late & history.stepped[found], found - 1, found)
    more: list[Put] = []
    places: list[int] = []
    put = {each.at.step for each in record.puts_between(int(steps.min()), int(steps.max()) + 1)}
    for number in np.flatnonzero(~late & np.isin(steps, [*put])).tolist():
        push = active[number]
        puts = record.puts_between(push.at.step, push.at.step + 1)
        earlier = [each for each in puts if order(each.at) <= order(push.at)]
        if earlier:  # what was set after the push is not where it acted
            more.append(earlier[-1])
            places.append(number)
    if more:
        rows[places] = len(history) + np.arange(len(more))
        history = history.then(put_states(more, history))
    return history.at(rows)

"""`off-target` of a velocity motor: its joint does not turn as fast as it is told to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.targets import flips
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.held_off import at_limit, holds_off
from drop_physics.rules.joint import effort
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import HALF_THE_STEPS, SLOW
from drop_physics.trace.motors import VELOCITY


@joint_rule("off-target", "asked")
def too_slow(joints: JointColumns) -> Match:
    """A velocity motor is at its limit, most of the time that its target stood.

    What grips something, or presses its stop, is to stand still; and a target beyond every rate
    stands for a constant force.
    """
    goal = joints.target_velocity
    told = (joints.mode == VELOCITY) & (joints.impulse > 0) & (goal != 0)
    told &= np.abs(goal) < joints.steps.law.velocity_limit
    weak = told & joints.at_limit & ~flips(joints.driven)  # else that is motor-gain's
    takes = np.full_like(goal, np.nan)
    for k in np.flatnonzero(weak.any(axis=0)).tolist():
        row, way = int(np.flatnonzero(told[:, k])[-1]), np.sign(goal[:, k])
        if weak[row, k]:
            held, on = joints.scene.joints.holding(joints.driven, row), float(way[row])
            weak[:, k] &= held.stops[k] * on >= 0 and not holds_off(joints.scene, held, k, -on)
            takes[:, k] = held.needs[k] * on
    step = np.broadcast_to(joints.step[:, None], goal.shape).astype(np.float64)
    lasts = {"weak": weak, "rate": joints.rate, "goal": goal, "takes": takes}
    lasts |= {"limit": joints.limit}
    return Match(told, step, sums={"told": told * 1}, lasts=lasts, counts=weak * 1)


@too_slow.counts
def _(runs: Runs, _: Scene) -> NDArray[np.float64]:
    slow = runs.weak & (runs.rate / runs.goal < SLOW)
    return np.where(slow & (runs.count > HALF_THE_STEPS * runs.told), runs.count * 1.0, 0.0)


@too_slow.says
def _(worst: Worst) -> Said:
    rate, goal, unit, takes = worst.rate, worst.goal, f"{worst.unit}/s", worst.takes
    why = at_limit(effort(worst.limit, worst.effort), worst.count, worst.told)
    advice = cure = None
    if takes > worst.limit:
        here = effort(takes, worst.effort)
        why = Message("{weak}; holding it here takes {here}", weak=why, here=here)
        # Holding is the least of it: what turns takes more where it is heavier, and gets faster.
        advice = Message("give it more force")
        cure = Cure("force", worst.joint if worst.joints == 1 else None)
    message = Message("{joint}{more} ends at {rate:.2g} {unit}, its target is {target:.3g}: {weak}")
    return Said(
        message=message,
        values={"unit": unit, "target": goal, "weak": why},
        advice=advice,
        cure=cure,
        effect=Effect(abs(goal - rate), unit),
        share=abs(goal - rate) / abs(goal),
    )

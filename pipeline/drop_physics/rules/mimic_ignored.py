"""Why a joint does not follow the other that its file names: PyBullet ignores `<mimic>`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.commands import DEFAULT
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.joint import distance
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import FOLLOWS


@joint_rule("mimic-ignored", "asked")
def mimic_ignored(joints: JointColumns) -> Match | None:
    """Where both are at rest, or at the end, a joint is not where its file wants it to follow."""
    places = zip(joints.body.joints, joints.body.rates, strict=True)
    rates = {each.name: at.start for each, at in places if each.widths[1] == 1}
    pairs = [each for each in joints.body.asked.mimics if {each.joint, each.of} <= rates.keys()]
    if not pairs:
        return None
    own, leads = (
        np.array([rates[getattr(each, name)] for each in pairs]) for name in ("joint", "of")
    )
    times, offset = np.array([(each.multiplier, each.offset) for each in pairs]).T
    low, high = np.array([j.limits for j in joints.body.joints for _ in range(j.widths[1])]).T
    extent = np.where(high > low, high - low, 1.0)[own]
    began, apart = (
        at[:, own] - times * at[:, leads] - offset for at in (joints.before, joints.after)
    )
    rests = joints.resting[:, own] & joints.resting[:, leads]
    drives = (joints.mode != DEFAULT) & (joints.asked.force != 0)

    def column(values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of the followers as a column of all joints."""
        found = np.zeros(joints.after.shape)
        found[:, own] = values
        return found

    return Match(
        column(np.ones(apart.shape)) > 0,
        column(np.abs(apart)),
        {"site": np.full(joints.after.shape, np.nan)},
        most={
            "high": column(apart),
            "low": column(-apart),
            "rested": column(np.abs(apart) * rests),
            "sent": column(drives[:, own] | drives[:, leads]),
        },
        firsts={"began": column(began)},
        lasts={"now": column(np.abs(apart)), "extent": column(extent + 0.0 * apart)},
        counts=(column(np.abs(apart)) > FOLLOWS * column(extent + 0.0 * apart)).astype(np.int64),
    )


@mimic_ignored.counts
def _(runs: Runs, _: Scene) -> NDArray[np.float64]:
    moved = np.maximum(runs.high - runs.began, runs.low + runs.began)
    share = np.maximum(runs.rested, runs.now) / runs.extent
    return np.where((moved > FOLLOWS * runs.extent) & (share > FOLLOWS), share, 0.0)


@mimic_ignored.says
def _(worst: Worst) -> Said:
    gap = max(worst.rested, worst.now)
    mimic = next(each for each in worst.subject.asked.mimics if each.joint == worst.joint)
    return Said(
        level=None if worst.sent else "note",
        message=Message(
            "{joint} is {gap} away from where its <mimic> tag puts it: PyBullet ignores "
            "the tag, so it does not follow {of} (joints that do not follow: {count})"
        ),
        values={"gap": distance(gap, worst.unit), "of": mimic.of, "count": worst.joints},
        advice=Message(
            "join them: c = p.createConstraint(…, p.JOINT_GEAR, …); "
            "p.changeConstraint(c, gearRatio={ratio}, maxForce=…), and turn its own motor off, "
            "which else holds both: "
            "p.setJointMotorControl2(…, {link}, p.VELOCITY_CONTROL, force=0)",
            ratio={1.0: "-1", -1.0: "1"}.get(mimic.multiplier, "…"),
            link=worst.link,
        ),
        cure=Cure("mimic", worst.body),
        effect=Effect(gap, worst.unit),
        share=gap / worst.extent,
    )

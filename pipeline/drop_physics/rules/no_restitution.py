"""`no-restitution`: why something does not bounce that a call gave restitution."""

from __future__ import annotations

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.rule import Match, Said, Worst, pair_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import BOUNCES_M_S, PLACED_M_S, SOFTLY, SWALLOWED
from drop_physics.trace.acts import Act

OF_THRESHOLD = "restitutionVelocityThreshold"


@pair_rule("no-restitution", "asked")
def no_restitution(pair: PairColumns) -> Match | None:
    """The engine multiplies both bodies' restitution; that of most is 0.

    Or they meet slower than Bullet's threshold, or a contact stops them before they touch: of the
    rebound `e v - gap / timestep` is left.
    """
    scene, body = pair.scene, pair.pairs.body
    asked = scene.asked.of["restitution"].values
    springy = np.isin(body, [number for number, value in asked.items() if value > 0])
    if not springy.any():
        return None
    approach, rebound = pair.approach_m_s, pair.parting_m_s
    meets = springy.any(axis=1) & (body[:, 0] != body[:, 1])
    # What is placed, not dropped, comes slowly; what takes longer than a step to stop is soft.
    meets &= (approach > PLACED_M_S) & (rebound > -SOFTLY * approach)
    first = (np.isin(body, scene.moving) * 2 + springy).argmax(axis=1)
    rows = np.arange(len(body))
    # A corner that comes down after the impact is faster: the first that may bounce counts.
    may_bounce = 1.0 + (approach > BOUNCES_M_S)
    numbers = {"approach": approach, "rebound": rebound, "product": pair.restitution}
    numbers |= {"gap": pair.gap_m, "lost": pair.gap_m / pair.timestep_s, "step": pair.step}
    keys = np.stack([body[rows, first], body[rows, 1 - first]], axis=1)
    return Match(meets, may_bounce, numbers, keys=keys)


@no_restitution.says
def _(worst: Worst) -> Said | None:
    scene, pair, gap_m = worst.scene, (worst.subject, worst.partner), worst.gap
    asked, speed, product = scene.asked.of["restitution"], worst.approach, worst.product
    springy, none = pair if asked.values.get(pair[0].number, 0.0) > 0 else pair[::-1]
    wanted, other = (asked.values.get(each.number, 0.0) for each in (springy, none))
    slow = product > 0 and speed < BOUNCES_M_S
    early = not slow and worst.lost > (1 - SWALLOWED) * product * speed > 0
    if not (slow or early) and (product > 0 or other > 0 or speed < BOUNCES_M_S):
        return None  # it bounces as the engine has it: a link has none, or it came later
    chosen_threshold = any(OF_THRESHOLD in each.low for each in scene.inputs.of(Act.SET_ENGINE))
    if speed < BOUNCES_M_S and chosen_threshold:
        return None  # then it is not Bullet's own threshold that counts
    share = product if slow or early else wanted
    # It may have had another when they met; or a call asked for just that.
    meant = springy.number in asked.changed or asked.since[springy.number] >= worst.step
    meant |= none.number in asked.values and other == 0
    soft = scene.asked.of["contactStiffness"].values.keys() & {each.number for each in pair}
    if meant or soft or worst.rebound > SWALLOWED * share * speed:
        return None
    chosen = {
        number
        for number, value in asked.values.items()
        if value > 0 and scene.body(number).moving and scene.body(number).client == none.client
    }
    # A floor has restitution for other things.
    if not (springy.moving or none.number in chosen or not (none.joints or chosen)):
        return None
    if slow:
        why = Message("PyBullet lets nothing bounce that comes slower than 0.2 m/s")
        advice = Message(
            "p.setPhysicsEngineParameter(restitutionVelocityThreshold=…) sets that speed"
        )
        cure = Cure("restitution", given={"restitutionVelocityThreshold": 0})
    elif early:
        why = Message(
            "PyBullet stops it {gap:.3g} mm before they touch, and takes that distance over the "
            "timestep off its rebound",
            gap=gap_m * 1e3,
        )
        advice = Message(
            "p.changeDynamics(body, -1, contactProcessingThreshold=0) on both lets contacts act "
            "only where they touch"
        )
        both = worst.body, worst.other
        cure = Cure("restitution", given={"contactProcessingThreshold": 0}, bodies=both)
    else:
        why = Message("restitution is the product of both bodies', {asked:.3g} × 0", asked=wanted)
        advice = Message(
            "give {other} restitution, too: p.changeDynamics(…, restitution=1)", other=none.label
        )
        cure = Cure("restitution", none.label, 1.0, bodies=(none.label,))
    message = Message(
        "{body} does not bounce off {other}: it meets it at {speed:.3g} m/s and leaves at "
        "{rebound:.3g} m/s; {why}"
    )
    values = {"speed": speed, "rebound": max(worst.rebound, 0.0), "why": why}
    return Said(
        message=message,
        values=values,
        advice=advice,
        cure=cure,
        effect=Effect(share * speed, "m/s"),
        share=share,
        site=asked.site(springy.number),
    )

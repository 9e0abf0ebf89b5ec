"""Describes how another engine's steps deviate from MuJoCo's, a sentence per kind."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.engines.mujoco.importing.gaps import Gap, Gaps
from drop_physics.engines.mujoco.importing.growth import GrowingStates
from drop_physics.fields import counted
from drop_physics.messages import Message

MOST = 4
"""Largest number of kinds of deviation that are described."""
STIFF = 1.0
"""Value of stiffness × h², or damping × h, divided by inertia, below which an integrator is stable.
"""


def said_of_gaps(
    explained: int, steps: int, gaps: Gaps, *, engine: str, rounding: float
) -> Iterator[Message]:
    """Yield sentences on how many steps are explained, and on how the others deviate.

    Parameters
    ----------
    explained, steps
        The number of steps that agree with MuJoCo's within rounding, and the number of all steps.
    gaps
        The deviations of the other steps.
    engine
        Name and version of MuJoCo.
    rounding
        Relative rounding of the stored numbers.
    """
    if explained == steps:
        yield Message(
            "{steps}: {engine} leads from each state to the next within rounding ({rounding:.1e})",
            steps=counted(steps, "step"),
            engine=engine,
            rounding=rounding,
        )
        return
    yield Message(
        "{off:,} of {steps} are not {engine}'s, off by what is on the next lines",
        off=steps - explained,
        steps=counted(steps, "step"),
        engine=engine,
    )
    if gaps.looked_at < gaps.steps:
        yield Message("{looked:,} of these were looked at", looked=gaps.looked_at)
    for gap in gaps.in_order()[:MOST]:
        yield _said(gap)


def _said(gap: Gap) -> Message:
    """Describe a group of steps that deviate in the same way."""
    of = {"steps": counted(gap.steps, "step"), "first": gap.first, "apart": gap.apart}
    kind, names = gap.kind, gap.names
    what = " ".join([kind, *names])
    if kind == "positions":
        return Message(
            "{steps}, the first from state {first}: velocities are MuJoCo's, positions are not "
            "where these lead",
            **of,
        )
    if kind == "contacts" and len(names) > 1:
        return Message(
            "{steps}, the first from state {first}: what {a} and {b} do to each other, {depth:.3g} "
            "mm inside each other there; by up to {apart:.2g} m/s or rad/s",
            **of,
            a=names[0],
            b=names[1],
            depth=1e3 * gap.depth_m,
        )
    if kind == "everything":
        return Message(
            "{steps}, the first from state {first}: by no one term; by up to {apart:.2g} m/s or "
            "rad/s",
            **of,
        )
    if gap.factor is not None:
        return Message(
            "{steps}, the first from state {first}: {what} has {factor:.3g} times the force",
            **of,
            what=what,
            factor=gap.factor,
        )
    return Message(
        "{steps}, the first from state {first}: {what}; by up to {apart:.2g} m/s or rad/s",
        **of,
        what=what,
    )


def said_of_growth(growth: GrowingStates) -> Message:
    """Describe why the states grow without bound."""
    kind, names = growth.term
    of = {"state": growth.state, "factor": growth.factor, "joint": growth.joint}
    term = " ".join([kind, "/".join(names)]).strip()
    if growth.loud:
        return Message(
            "{term} is given {force:.3g} from state {state} on, {factor:.2g} times as much as any "
            "is before",
            **of,
            term=term,
            force=growth.loud,
        )
    inertia = f"{growth.inertia:.2g} {'kg' if growth.unit == 'm' else 'kg m²'}"
    values = of | {"term": term, "inertia": inertia}
    if kind == "contacts" and growth.depth_m > 0.0:
        return Message(
            "from state {state} on a step multiplies what is off by {factor:.3g}, in {joint}, by "
            "the contact of {a} and {b}, which are {depth:.3g} mm inside each other there",
            **values,
            a=names[0],
            b=names[-1],
            depth=1e3 * growth.depth_m,
        )
    stiff, damped = growth.stiffness, growth.damping
    if max(stiff, damped) < STIFF:
        return Message(
            "from state {state} on a step multiplies what is off by {factor:.3g}, in {joint} (an "
            "inertia of {inertia}), by {term}",
            **values,
        )
    geared = kind == "actuator"
    if stiff > damped:
        law = Message("kp gear² h²/I") if geared else Message("its stiffness × h²/I")
        return Message(
            "from state {state} on a step multiplies what is off by {factor:.3g}, in {joint} (an "
            "inertia of {inertia}), by {term}: {law} = {ratio:.3g}, where without damping "
            "{most:.3g} is the most",
            **values,
            law=law,
            ratio=stiff,
            most=growth.most[0],
        )
    law = Message("kv gear² h/I") if geared else Message("its damping × h/I")
    return Message(
        "from state {state} on a step multiplies what is off by {factor:.3g}, in {joint} (an "
        "inertia of {inertia}), by {term}: {law} = {ratio:.3g}, where {most:.3g} is the most",
        **values,
        law=law,
        ratio=damped,
        most=growth.most[1],
    )

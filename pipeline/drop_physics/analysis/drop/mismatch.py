"""How far the recorded state follows the law of the recorded engine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.phases import Phases
from drop_physics.analysis.drop.results import ContactPhase, Coverage
from drop_physics.analysis.general.segments import CONTACT
from drop_physics.analysis.results import Explained
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.scenario import Engine

LEFT_M_S2 = 0.02
"""Acceleration at a body's edge that MuJoCo's solver may leave unbalanced by default; measured:
0.004."""
MUJOCO_RESIDUAL, MUJOCO_ITERATIONS = 1e-8, 100
"""MuJoCo's defaults; with a larger residual, or fewer iterations, it leaves whatever is left."""
LEAST_FRICTION = 0.1
"""With less, MuJoCo's forces may not balance; measured: never with 0.05, in 1 of 14 with 0.01."""
NO_BALANCE: dict[Engine, Message] = {
    "drake": Message(
        "Drake reports contact forces only to its solver's tolerance, and no torque of a patch"
    ),
    "physx": Message("SAPIEN reports no friction, and PhysX moves bodies in contact differently"),
}
"""Why the contact of an engine is not explained."""


@dataclass(frozen=True)
class Mismatch:
    """The first sample that the law covers and that does not follow it."""

    step: int
    deviation: float
    """By how much, in the worst of its numbers [m, m/s or rad/s]."""


def find_mismatch(case: Case, phases: Phases) -> Mismatch | None:
    """Return the first sample that the law covers but does not lead to, or None.

    The release counts as in the air, whatever contacts are recorded.
    """
    step = case.segments.first_unexplained
    if step is None or (case.scenario.stepped and not case.is_rigid):
        return None
    touched = step >= max(1, phases.airborne) or _near_unbalanced(case, step)
    if touched and _uncovered(case, step) is not None:
        return None
    if _unknown(case, step):
        return None
    return Mismatch(step, float(case.segments.deviation[step]))


def clamped_step(case: Case, phases: Phases) -> int | None:
    """Return the first sample in the air that was clamped to ±100 m/s or rad/s, or None."""
    held = np.flatnonzero(case.segments.held[1 : max(1, phases.airborne)])
    return int(held[0]) + 1 if len(held) else None


def unseen_contact(case: Case, mismatch: Mismatch | None) -> int | None:
    """Return the sample at which a contact acted that the engine does not report, or None.

    A body that departs from the law within reach of the floor has touched it.
    """
    if mismatch is None or not case.hides_contacts or not case.scenario.floor:
        return None
    around_m = case.samples.position_m[max(mismatch.step - 1, 0) : mismatch.step + 1]
    way_m = np.abs(case.samples.velocity_m_s[max(mismatch.step - 1, 0)]).max() * case.timestep_s
    within = float(around_m[:, 2].min()) <= case.engine.reach_m + way_m
    return mismatch.step if within else None


def _uncovered(case: Case, step: int) -> Message | None:
    """Return why neither law nor contact forces cover a sample after a contact; None if they do."""
    if not case.is_rigid:
        return Message(
            "the body has {joints}, and the laws here are those of one rigid body",
            joints=counted(case.engine.joints, "joint"),
        )
    if not case.scenario.stepped:
        return None
    if case.substeps > 1:
        return Message(
            "it may have touched: of several substeps PyBullet reports only the contacts of the "
            "last"
        )
    if case.hides_contacts:
        return Message(
            "it may have touched: {engine} reports only the contacts of a step's last stage",
            engine=case.engine_name,
        )
    if _near_unbalanced(case, step):
        return NO_BALANCE[case.scenario.engine]
    contact = case.segments.contact
    touched = contact is not None and bool(contact.touched[step])
    if touched and (case.engine.rolling_friction or case.engine.spinning_friction):
        return Message("rolling or spinning friction acts, which PyBullet does not report")
    if case.scenario.engine == "mujoco" and _has_points(case, step):
        return _left_by_mujoco(case, step)
    if touched and step == 1 and case.scenario.coordinates == "maximal":
        return Message(
            "in its first step a btRigidBody is pushed with the inertia it was loaded with"
        )
    return None


def _near_unbalanced(case: Case, step: int) -> bool:
    """Whether a step had contact points, touching or not, in an engine without a balance."""
    return case.scenario.engine in NO_BALANCE and _has_points(case, step)


def _has_points(case: Case, step: int) -> bool:
    return bool((case.touches.step == step).any())


def _unknown(case: Case, step: int) -> Message | None:
    """Return why no law of a step is known; None where it is."""
    if not case.is_rigid or case.law.covers(case.samples.before())[step]:
        return None
    return Message(
        "no law of a step is known for {engine}'s {integrator} integration of spin or damping",
        engine=case.engine_name,
        integrator=case.scenario.effective_integrator,
    )


def _left_by_mujoco(case: Case, step: int) -> Message | None:
    """Return why contact forces need not balance in MuJoCo, or None if its solver ensures that."""
    residual, engine = case.scenario.solver_residual, case.engine
    friction = max(engine.lateral_friction or 0.0, engine.floor_lateral_friction or 0.0)
    if friction < LEAST_FRICTION:
        return Message(
            "with a friction as low as {friction:g} the contact forces that MuJoCo reports do not "
            "balance",
            friction=friction,
        )
    if (case.engine.solver_iterations or 0) < MUJOCO_ITERATIONS:
        return Message(
            "MuJoCo's solver may stop before its forces balance; with --solver-residual 0, and "
            "without --solver-iterations, they do"
        )
    if residual == 0:
        return None
    if (residual or 0) > MUJOCO_RESIDUAL or _nearly(case, step):
        return Message(
            "MuJoCo's solver may stop before its forces balance; with --solver-residual 0 they do"
        )
    return None


def _nearly(case: Case, step: int) -> bool:
    """Whether a sample deviates from its law by no more than MuJoCo's solver leaves by default."""
    reach_m, dt = max(case.engine.reach_m, 1e-12), case.timestep_s
    return bool(case.segments.deviation[step] <= LEFT_M_S2 * dt * max(1.0, 1 / reach_m))


def explained_of(case: Case, mismatch: Mismatch | None) -> Explained:
    """Say how much of a recording is explained step by step, and what ends it."""
    segments, of = case.segments, len(case.samples)
    samples, step = int(segments.explained.sum()), segments.first_unexplained
    if step is None:
        return Explained(samples, of, 0.0, (of - 1) * case.timestep_s, None)
    why = None if mismatch is not None else _unknown(case, step) or _uncovered(case, step)
    unlike = Message("the state is not what the engine computes from the sample before")
    return Explained(
        samples,
        of,
        0.0,
        (step - 1) * case.timestep_s if step else None,
        Message("at sample {step} {why}", step=step, why=why or unlike),
    )


def contact_phases(case: Case) -> list[ContactPhase]:
    """Return what each unbroken contact gave to the body, in order."""
    contact = case.segments.contact
    if contact is None:
        return []
    contacts = []
    for first, last in case.segments.runs(CONTACT):
        impulses = contact.impulse_n_s[first : last + 1]
        x, y, z = impulses.sum(axis=0).tolist()
        largest_n = float(np.linalg.norm(impulses, axis=1).max()) / case.timestep_s
        kinetic_j = float(contact.energy_j[first : last + 1].sum())
        contacts.append(ContactPhase(first, last, (x, y, z), largest_n, kinetic_j))
    return contacts


def coverage_of(
    case: Case, phases: Phases, mismatch: Mismatch | None, clamped: int | None
) -> Coverage:
    """Say which samples are broken down: those in free flight, by the law and in theory."""
    of = phases.samples
    if not case.scenario.stepped:
        return Coverage(0, of, Message("no step was taken, so no law of motion applies"))
    if not case.is_rigid:
        why = Message(
            "the body has {joints}, and the law is that of one rigid body",
            joints=counted(case.engine.joints, "joint"),
        )
        return Coverage(0, of, why)
    ends = [(of, Message("the whole recording is in free flight"))]
    if mismatch is not None:
        why = Message("the state does not follow {engine}'s law", engine=case.engine_name)
        ends.append((mismatch.step, why))
    if clamped is not None:
        ends.append((clamped, Message("a velocity is clamped to Bullet's limit of 100")))
    fallen = Message("free fall has reached the floor, where theory ends")
    ends.append((case.lands_at, fallen))
    ends.append((phases.airborne, Message("the body is, or has been, in contact")))
    step = case.segments.first_unexplained
    if step is not None and mismatch is None:
        why = Message("it is unexplained")
        ends.append((step, _unknown(case, step) or _uncovered(case, step) or why))
    samples, why = min(ends, key=lambda end: end[0])
    if samples < of:
        why = Message("from sample {step} on {why}", step=samples, why=why)
    return Coverage(samples, of, why)

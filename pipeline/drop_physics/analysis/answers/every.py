"""All answers, and in which order a reader sees what they found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from drop_physics.analysis.answers.answer import Answer, Finding
from drop_physics.analysis.answers.beyond_urdf import BeyondUrdf
from drop_physics.analysis.answers.bounces import EnergyGained, NoRestitution
from drop_physics.analysis.answers.collides_as_hull import CollidesAsHull
from drop_physics.analysis.answers.deep_penetration import DeepPenetration
from drop_physics.analysis.answers.default_motor import DefaultMotor
from drop_physics.analysis.answers.dragged_by_nothing import DraggedByNothing
from drop_physics.analysis.answers.friction_pyramid import FrictionPyramid
from drop_physics.analysis.answers.ik_off import IkOff
from drop_physics.analysis.answers.inertia import Inertia
from drop_physics.analysis.answers.joined import Joined
from drop_physics.analysis.answers.joint_damping import JointDamping
from drop_physics.analysis.answers.mimic_ignored import MimicIgnored
from drop_physics.analysis.answers.momentum import MomentumDrift
from drop_physics.analysis.answers.motion import DefaultDamping, Teleported, TimestepTooLong
from drop_physics.analysis.answers.motor_gain import MotorGain
from drop_physics.analysis.answers.off_target import OffTarget
from drop_physics.analysis.answers.other_force import SubstepsScaleMotors, TimestepAfterMotor
from drop_physics.analysis.answers.pushes import ForceOffCentre, PushLastedAStep
from drop_physics.analysis.answers.reset_leaves import RatesLeft, ResetLeaves
from drop_physics.analysis.answers.restored import RestoreDiffers
from drop_physics.analysis.answers.script_failed import ScriptFailed
from drop_physics.analysis.answers.setup import (
    NoGravity,
    NotStepped,
    RealTime,
    TimestepChanged,
    Unseeded,
)
from drop_physics.analysis.answers.slides import Creeps, Slides
from drop_physics.analysis.answers.starts_in_contact import StartsInContact
from drop_physics.analysis.answers.still import Asleep, Massless
from drop_physics.analysis.answers.targets import TargetClamped
from drop_physics.analysis.answers.tunnelled import Tunnelled
from drop_physics.analysis.answers.unstable import NotFinite, Unstable
from drop_physics.analysis.answers.wheel_slip import WheelSlip
from drop_physics.messages import Message

ANSWERS: tuple[type[Answer], ...] = (
    # joints
    OffTarget,
    DefaultMotor,
    SubstepsScaleMotors,
    TimestepAfterMotor,
    MotorGain,
    ResetLeaves,
    RatesLeft,
    JointDamping,
    BeyondUrdf,
    MimicIgnored,
    IkOff,
    WheelSlip,
    # contacts
    StartsInContact,
    Slides,
    Creeps,
    NoRestitution,
    DeepPenetration,
    EnergyGained,
    FrictionPyramid,
    DraggedByNothing,
    CollidesAsHull,
    Tunnelled,
    # calls and files
    ScriptFailed,
    NotStepped,
    NoGravity,
    TimestepChanged,
    RealTime,
    Unseeded,
    PushLastedAStep,
    ForceOffCentre,
    Inertia,
    TargetClamped,
    Joined,
    Massless,
    TimestepTooLong,
    DefaultDamping,
    Teleported,
    RestoreDiffers,
    # the whole
    Asleep,
    MomentumDrift,
    NotFinite,
    Unstable,
)


def ranked(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings, the gravest first; the same one on many bodies is one, the worst of them."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for each in findings:
        text = each.message.template if isinstance(each.message, Message) else each.message
        groups.setdefault((each.code, text), []).append(each)
    return sorted((_one_of(group) for group in groups.values()), key=lambda each: each.rank)


def _one_of(group: list[Finding]) -> Finding:
    worst = min(group, key=lambda each: each.rank)
    if worst.body is None:
        return worst
    # One that stands for several bodies already counts them.
    counts = {each.body: each.bodies for each in group}
    return replace(worst, bodies=sum(counts.values()))

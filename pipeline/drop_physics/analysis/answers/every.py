"""All answers, and in which order a reader sees what they found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from drop_physics.analysis.answers.answer import Answer, Finding
from drop_physics.analysis.answers.asleep import Asleep
from drop_physics.analysis.answers.beyond_urdf import BeyondUrdf
from drop_physics.analysis.answers.collides_as_hull import CollidesAsHull
from drop_physics.analysis.answers.creeps import Creeps
from drop_physics.analysis.answers.deep_penetration import DeepPenetration
from drop_physics.analysis.answers.default_damping import DefaultDamping
from drop_physics.analysis.answers.default_motor import DefaultMotor
from drop_physics.analysis.answers.dragged_by_nothing import DraggedByNothing
from drop_physics.analysis.answers.energy_gained import EnergyGained
from drop_physics.analysis.answers.force_off_centre import ForceOffCentre
from drop_physics.analysis.answers.friction_pyramid import FrictionPyramid
from drop_physics.analysis.answers.ik_off import IkOff
from drop_physics.analysis.answers.impossible_inertia import ImpossibleInertia
from drop_physics.analysis.answers.inertia_from_shape import InertiaFromShape
from drop_physics.analysis.answers.inertia_without_mass import InertiaWithoutMass
from drop_physics.analysis.answers.joined import Joined
from drop_physics.analysis.answers.joint_damping import JointDamping
from drop_physics.analysis.answers.massless import Massless
from drop_physics.analysis.answers.mimic_ignored import MimicIgnored
from drop_physics.analysis.answers.momentum_drift import MomentumDrift
from drop_physics.analysis.answers.motor_gain import MotorGain
from drop_physics.analysis.answers.no_gravity import NoGravity
from drop_physics.analysis.answers.no_inertial import NoInertial
from drop_physics.analysis.answers.no_restitution import NoRestitution
from drop_physics.analysis.answers.not_finite import NotFinite
from drop_physics.analysis.answers.not_stepped import NotStepped
from drop_physics.analysis.answers.off_target import OffTarget
from drop_physics.analysis.answers.push_lasted_a_step import PushLastedAStep
from drop_physics.analysis.answers.rates_left import RatesLeft
from drop_physics.analysis.answers.real_time import RealTime
from drop_physics.analysis.answers.reset_leaves import ResetLeaves
from drop_physics.analysis.answers.restore_differs import RestoreDiffers
from drop_physics.analysis.answers.script_failed import ScriptFailed
from drop_physics.analysis.answers.slides import Slides
from drop_physics.analysis.answers.starts_in_contact import StartsInContact
from drop_physics.analysis.answers.substeps_scale_motors import SubstepsScaleMotors
from drop_physics.analysis.answers.target_clamped import TargetClamped
from drop_physics.analysis.answers.teleported import Teleported
from drop_physics.analysis.answers.timestep_after_motor import TimestepAfterMotor
from drop_physics.analysis.answers.timestep_changed import TimestepChanged
from drop_physics.analysis.answers.timestep_too_long import TimestepTooLong
from drop_physics.analysis.answers.too_slow import TooSlow
from drop_physics.analysis.answers.tunnelled import Tunnelled
from drop_physics.analysis.answers.unseeded import Unseeded
from drop_physics.analysis.answers.unstable import Unstable
from drop_physics.analysis.answers.wheel_slip import WheelSlip
from drop_physics.messages import Message

ANSWERS: tuple[type[Answer], ...] = (
    # joints
    OffTarget,
    TooSlow,
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
    InertiaFromShape,
    NoInertial,
    ImpossibleInertia,
    InertiaWithoutMass,
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

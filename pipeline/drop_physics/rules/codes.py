"""Levels of findings, and descriptions of their codes and reasons, in scripts and in drops."""

from __future__ import annotations

from typing import Literal, get_args

Level = Literal["broken", "asked", "model", "repeat", "note"]
LEVELS: tuple[Level, ...] = get_args(Level)
"""The levels, the gravest first: no longer physical; not what the script requested; correct for the
engine, but perhaps not intended; may differ in another run; worth knowing."""
CODES: dict[str, str] = {
    "actuatorfrcrange": "The joint lets through only a part of what its actuator gives.",
    "armature": "A joint is slow because its armature is far more than the inertia that it moves.",
    "asleep": "A body does not react: the engine put it to sleep, and nothing woke it.",
    "auto-reset": (
        "MuJoCo put the state back by itself after a warning, and the run went on from there."
    ),
    "beyond-urdf": (
        "A joint went faster, or its motor pushed harder, than its file allows: PyBullet's "
        "motors do not enforce that."
    ),
    "both-static": (
        "Neither of two bodies that overlap has mass: PyBullet makes no contacts between them."
    ),
    "buffer-full": (
        "MuJoCo's memory was full: contacts or constraints found no place in it, and did not act."
    ),
    "bounce-swallowed": (
        "A bounce is missing: a contact acted before the body touched, or it came too slowly."
    ),
    "call-elsewhere": (
        "A call of changeDynamics for a link reached the base: a later argument of it carries "
        "it there."
    ),
    "collides-as-hull": (
        "A hollow mesh collides as its convex hull, and was touched off its surface."
    ),
    "command-overwritten": (
        "A joint is commanded for a position and for a rate before one step; the last one counts."
    ),
    "constraint-apart": (
        "A constraint joins two frames that do not meet, and pulls or turns them together."
    ),
    "constraint-lags": (
        "What is held to a body that only calls move follows behind: that body has no velocity."
    ),
    "condim": "Contacts of these bodies have no friction, whatever coefficient they are given.",
    "contact-despite-filter": (
        "Two bodies touch although a mask forbids it: by default one mask that lets them is enough."
    ),
    "creeps": (
        "A body that friction could hold creeps all the same: the solver leaves some of its "
        "velocity."
    ),
    "deep-penetration": "A body sank further into another than a contact should allow.",
    "damper": "A velocity actuator is a damper: against a load it does not get to its target.",
    "default-damping": "PyBullet's damping, 0.04 unless a call sets it, took energy.",
    "default-motor": (
        "The motor that PyBullet gives every joint holds one that something was to move."
    ),
    "dragged-by-nothing": (
        "What lies on a body that calls move stays behind: a pose that is set has no velocity."
    ),
    "drive-lags": (
        "A constraint's target is set from where the body is, so only a share of each change "
        "is made."
    ),
    "energy-gained": "Contacts gave bodies energy, which they cannot.",
    "filter": "A call or the model switched a pair off that overlaps later.",
    "flag": "A flag of the model switches off what was to act.",
    "force-off-centre": (
        "A force acted beside a body that it was meant for: the point is in another frame."
    ),
    "forcerange": "An actuator is at the limit of its force.",
    "free-base": "An arm tips over, because its base is not fixed.",
    "friction-loss": "A joint's dry friction takes what drives it, or holds it off its target.",
    "friction-pyramid": (
        "Friction is a pyramid along two axes, and turned or braked a body that slides "
        "between them."
    ),
    "gravcomp": "gravcomp takes all of gravity off a body.",
    "ik-index": "Answers of inverse kinematics went to joints by index, fixed ones among them.",
    "ik-off": (
        "A hand is off its point although its joints are on their targets: inverse kinematics "
        "gave an answer that is off."
    ),
    "gain-per-step": (
        "A gain is a share per step: at a short timestep it asks for more than the motor can give."
    ),
    "gear": "A position actuator divides what it is given by its gear.",
    "inactive": "An equality of the model is not active, and holds nothing.",
    "impossible-inertia": "No body can have the inertia that a file gives.",
    "inertia-from-shape": (
        "PyBullet computes the inertia from the collision shape, not from the file."
    ),
    "inertia-without-mass": "A link has inertia, and no mass.",
    "joint-damping": "A joint's damping or dry friction takes most of the torque that it is given.",
    "joint-index": "Targets went to joints by index, fixed ones among them.",
    "keyframe": "A model has a keyframe, and the run does not begin in it.",
    "law-mismatch": "A sample is not what the law says of the one before.",
    "link-counted-static": (
        "A link that is fixed to the first link of a robot with a fixed base counts as static."
    ),
    "margin": "A margin lets contacts push before bodies touch.",
    "massless": "A body has no mass, and so stays where it is.",
    "mimic-ignored": (
        "A joint does not follow the one that its file wants it to mimic: PyBullet ignores that."
    ),
    "model-edited": (
        "The script changed MuJoCo's model, and what follows from it was not worked out again."
    ),
    "momentum-drift": (
        "A body's momentum changed where nothing outside acts: by the integrator, or by damping."
    ),
    "motor-gain": "Gains, which are shares per step, make a motor overshoot, ring or grow.",
    "no-contact": "Bodies overlap, and nothing pushes them apart.",
    "no-effect": "PyBullet ignores what was asked.",
    "no-floor": "There is no floor, and the body falls on.",
    "no-gravity": "There is no gravity, or no longer, and bodies do not fall.",
    "no-inertial": "A link has no <inertial>, and so a mass of 1 kg.",
    "no-restitution": (
        "What was given restitution does not bounce: that of both bodies is multiplied, or it "
        "came too slowly."
    ),
    "no-shape": "A body has mass and no collision shape, and falls through others.",
    "not-finite": "A state became infinite, or no number.",
    "not-replayed": (
        "Steps of MuJoCo could not be repeated from what was recorded, and are not explained."
    ),
    "not-stepped": "Nothing was ever stepped, so nothing moved.",
    "not-taken": "The engine ignores what was asked.",
    "off-target": "A joint is not where, or not as fast as, its motor was told.",
    "other-client": (
        "A setter without physicsClientId is client 0's: another simulation never got it."
    ),
    "overwritten": "A call undoes, step after step, what acts, or is undone itself.",
    "parent-and-child": "A link and its parent do not collide, and these overlap.",
    "pose-set-each-step": (
        "A pose that is set step by step has no force, and goes through what it meets."
    ),
    "push-lasted-a-step": "A force lasts one step, and was given in one of several.",
    "push-stays": (
        "A force of MuJoCo stays until it is written again, and acted longer than it was meant to."
    ),
    "quaternion-order": "A quaternion was written with w last, where the engine has it first.",
    "range": "A joint rests at the end of its range, short of its target.",
    "reading": "What a number that the script reads stands for.",
    "reading-depth": "The depth of a camera's picture is no distance.",
    "reading-stale": "The pose of a link is that of one step earlier.",
    "reading-static": "The velocity of a base that only calls move is 0.",
    "reading-torque": "The torque that is read is the motor's, and that is off.",
    "real-time": "The engine steps by its own clock, so each run is another.",
    "reset-clears": "A reset sets what actuators are given to zero, and nothing gives it again.",
    "reset-frame": "A reset places the centre of mass where a load places the file's origin.",
    "reset-leaves": (
        "A reset leaves motors their targets, or joints their rates, and they drive on."
    ),
    "rest-below-expected": "A body rests lower than its shape says.",
    "restitution-inflated": "A bounce is higher than the restitution asked for.",
    "restore-differs": "What began in the same state, with the same calls, ran otherwise.",
    "rolling-friction": "Rolling friction took the energy of what rolls.",
    "scale-keeps-mass": "globalScaling scales sizes and leaves masses as they are.",
    "script-failed": "The script ended with an error.",
    "self-collision": "A body's own links overlap and are pushed apart.",
    "slides": "A body that was held or rested slipped: friction was not enough.",
    "stale": "A step of MuJoCo used what had been computed for another state.",
    "spring": "A position actuator is a spring: a pose that takes a force is off its target.",
    "starts-in-contact": "A body was put inside another, and they were pushed apart.",
    "static-parent": "A body collides with its parent, as MuJoCo has it where that cannot move.",
    "still-airborne": "The recording ends before the body has landed.",
    "substeps-scale-motors": "With numSubSteps a motor's limit counts in each substep.",
    "taken-elsewhere": "What was asked acts, but on something else.",
    "target-clamped": "A target beyond a joint's limit is moved to it.",
    "teleported": "A call moved a body.",
    "timestep-after-motor": (
        "The timestep was set after a motor's call, which changes the motor's limit."
    ),
    "timestep-changed": "The timestep changed while bodies moved.",
    "timestep-too-long": "A body goes too far in one step.",
    "tumbled": "The body turned over.",
    "tunnelled": "A body got into another, or through it, between two steps.",
    "units": "A target is within a joint's limits, or a turn, if it is taken as degrees.",
    "unseeded": "The script uses random numbers without a seed.",
    "unstable": (
        "A rate changes its sign with every step: what acts against it is too stiff for the "
        "timestep."
    ),
    "velocity-clamped": "A rate reached the engine's limit, which took some of it.",
    "velocity-set-each-step": (
        "A velocity that is set before each step takes away what gravity gave."
    ),
    "weak-constraint": "A constraint gives way: it is at its limit, or the solver did not finish.",
    "wheel-slip": "Wheels turned farther than their robot went.",
    "wrong-body": "A body that was to stay was given mass.",
}
"""The codes and reasons that users can select, ignore and look up."""

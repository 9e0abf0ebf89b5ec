"""All thresholds of the rules in one table: value, unit, what it limits, and what needs it."""

from __future__ import annotations

from typing import NamedTuple, TypeVar


class Threshold(NamedTuple):
    """A number that decides whether a rule holds."""

    value: float
    unit: str
    """`share` of what the meaning names; `1` of a count."""
    meaning: str
    """What it limits, as a sentence."""
    evidence: str
    """The corpus case or measurement that needs it."""


Number = TypeVar("Number", int, float)
TABLE: dict[str, Threshold] = {}
"""All thresholds by the names of their constants."""


def _of(name: str, value: Number, unit: str, meaning: str, evidence: str) -> Number:
    TABLE[name] = Threshold(value, unit, meaning, evidence)
    return value


AT_TARGET_RAD = _of(
    "AT_TARGET_RAD",
    1e-2,
    "rad",
    "Distance from its target below which a joint has reached it.",
    "0.01 rad is half a degree",
)
AT_TARGET_M = _of(
    "AT_TARGET_M",
    1e-3,
    "m",
    "Distance from its target below which a sliding joint has reached it.",
    "a gripper's finger",
)
BEYOND_RANGE = _of(
    "BEYOND_RANGE",
    0.01,
    "share",
    "Least share of a joint's range by which a target lies beyond it.",
    "limits that files round",
)
OTHER_FORCE = _of(
    "OTHER_FORCE",
    0.01,
    "share",
    "Largest difference of a force from the one that was given.",
    "rounding of impulses",
)
CROSSINGS = _of(
    "CROSSINGS",
    3,
    "1",
    "Least number of steps in which a joint passes its target.",
    "a joint that passes it once or twice overshoots for another reason",
)
COASTS_RAD_S = _of(
    "COASTS_RAD_S",
    1e-2,
    "rad/s",
    "Least rate at which a joint without a motor coasts.",
    "crane_drift",
)
COASTS_STEPS = _of(
    "COASTS_STEPS",
    10,
    "1",
    "Least number of steps in which a joint does not do what its file or a call asks.",
    "crane_drift, spherical",
)
SCALE = _of(
    "SCALE",
    2,
    "1",
    "Least factor, up or down, by which a body is scaled.",
    "tiny_and_heavy",
)
FRAME_APART_M = _of(
    "FRAME_APART_M",
    1e-3,
    "m",
    "Least distance of a centre of mass from its file's origin that matters to a reset.",
    "base_com",
)
LEFT_M = _of(
    "LEFT_M", 1e-2, "m", "Least distance of a body that has left its place.", "mass_for_all"
)
TIPS_RAD = _of(
    "TIPS_RAD",
    0.5,
    "rad",
    "Least angle by which an arm's base tips over.",
    "no_fixed_base, 1.5 rad",
)
EACH_STEP = _of(
    "EACH_STEP",
    0.9,
    "share",
    "Least share of the steps that counts as every step.",
    "float_off_edge",
)
FALLS_STEPS = _of(
    "FALLS_STEPS",
    5,
    "1",
    "Least number of steps in flight before which a velocity was set.",
    "float_off_edge",
)
HALF_THE_STEPS = _of(
    "HALF_THE_STEPS",
    0.5,
    "share",
    "Least share of the steps from the first call on in which a pose is set step by step.",
    "reset_joint_each",
)
DEEP_M = _of(
    "DEEP_M", 1e-3, "m", "Largest overlap that a contact alone allows.", "reset_joint_each"
)
OVERLAPS_STEPS = _of(
    "OVERLAPS_STEPS", 5, "1", "Least number of steps with such an overlap.", "reset_joint_each"
)
SAME_GAP = _of(
    "SAME_GAP",
    0.05,
    "share",
    "Largest change of the gap between a body and the targets set from it.",
    "lift_by_constraint",
)
STALE_M = _of(
    "STALE_M",
    1e-3,
    "m",
    "Least distance that a link moves in one step, by which its stale pose is off.",
    "link_stale",
)
BOUNCES_M_S = _of(
    "BOUNCES_M_S",
    0.2,
    "m/s",
    "Bullet's own threshold: slower contacts do not bounce.",
    "btContactSolverInfo.h, m_restitutionVelocityThreshold",
)
PLACED_M_S = _of(
    "PLACED_M_S",
    9.81 / 60,
    "m/s",
    "Speed below which a body was placed, not dropped.",
    "right_placed: what gravity gives it in 1/60 s",
)
SOFTLY = _of(
    "SOFTLY",
    0.5,
    "share",
    "Least share of the approach that is left after a step where a contact gives way.",
    "contacts with a stiffness of their own",
)
SWALLOWED = _of(
    "SWALLOWED",
    0.5,
    "share",
    "Share of the requested rebound below which a body does not bounce.",
    "overlap alone lifts a little",
)
SMALL_GAIN = _of(
    "SMALL_GAIN",
    0.05,
    "share",
    "Largest positionGain that counts as small; PyBullet's is 0.1.",
    "slow arms",
)
LAWFUL_GAP = _of(
    "LAWFUL_GAP",
    0.1,
    "share",
    "Largest difference of a gap from what the motor's law leaves.",
    "targets that change with every step",
)
LIMITED_OFTEN = _of(
    "LIMITED_OFTEN",
    0.1,
    "share",
    "Least share of a motor's steps at its limit for that to be a cause.",
    "targets that change with every step",
)
SLOW = _of(
    "SLOW",
    0.5,
    "share",
    "Share of a velocity motor's target, below which its joint is too slow.",
    "a wheel that starts",
)
RINGS_STEPS = _of(
    "RINGS_STEPS",
    8,
    "1",
    "Least number of steps in a row in which a rate changes its sign.",
    "chatter: kuka's joint damping",
)
RINGS_LEAST = _of(
    "RINGS_LEAST",
    1e-2,
    "rad/s or m/s",
    "Rate below which a joint's changes of sign are noise.",
    "robots at rest",
)
RINGS_SHARE = _of(
    "RINGS_SHARE", 0.01, "share", "The same as a share of its greatest rate.", "robots at rest"
)
SWITCHES = _of(
    "SWITCHES",
    1e-6,
    "share",
    "Largest change in magnitude of forces that only change their sign.",
    "a pendulum that is driven by ±2 N m",
)
TURNS_MOST = _of(
    "TURNS_MOST",
    0.5,
    "share",
    "Least share of what turns a rate around that one term has.",
    "self_tremble",
)
TURNS_TOO = _of(
    "TURNS_TOO",
    0.1,
    "share",
    "Least share of that for a motor's gains to be the cause.",
    "gain_silent",
)
HAND_M = _of(
    "HAND_M",
    5e-3,
    "m",
    "Distance from its point below which a hand has reached it.",
    "ik_out_of_reach",
)
IK_JOINTS = _of(
    "IK_JOINTS",
    0.2,
    "share",
    "Largest share of a hand's miss that its joints add, off their targets.",
    "a weak arm",
)
IK_AGAIN = _of(
    "IK_AGAIN",
    50,
    "1",
    "Number of answers for one point, each from the last, after which it counts as out of reach.",
    "ik_out_of_reach",
)
IK_ENOUGH = _of(
    "IK_ENOUGH", 1000, "1", "Number of iterations beyond which more hardly help.", "kuka, panda"
)
EPISODE_STEPS = _of(
    "EPISODE_STEPS",
    10,
    "1",
    "Least number of steps of an episode: in a shorter one something is moved by resets.",
    "right scripts that animate",
)
EPISODES_MOST = _of(
    "EPISODES_MOST",
    20,
    "1",
    "Number of episodes of one kind that are compared: what differs does so in the first.",
    "reading a recording again takes its time",
)
BACK = _of(
    "BACK",
    1e-6,
    "rad or m",
    "Distance from where it was within which a call puts a joint back.",
    "reset; one that is put there with noise is not",
)
WATCHED = _of(
    "WATCHED",
    240,
    "1",
    "Number of steps for which a joint is watched after a keyframe put it somewhere.",
    "mujoco: keyframe_ctrl",
)
APART = _of(
    "APART",
    0.05,
    "share",
    "Least distance of the points that a constraint joins, over the smaller body's size.",
    "apart",
)
APART_RAD = _of(
    "APART_RAD",
    0.05,
    "rad",
    "Least angle between the frames that a constraint joins.",
    "constraint_turned",
)
CLOSES = _of(
    "CLOSES",
    0.5,
    "share",
    "Largest share of that gap that is left within ten steps: a spring leaves more.",
    "spring_constraint",
)
CLOSES_STEPS = _of(
    "CLOSES_STEPS",
    10,
    "1",
    "Number of steps in which a constraint closes its gap, or over which the gap stays.",
    "spring_constraint, weak",
)
STILL_M_S = _of(
    "STILL_M_S", 1e-3, "m/s", "Speed below which a side of a constraint stays where it is.", "weak"
)
PULLED_BACK = _of(
    "PULLED_BACK",
    0.99,
    "share",
    "Least share of a gap that is left, ten steps on, where nothing closes it.",
    "pendulums that hang there swing",
)
SLIPS_M_S = _of("SLIPS_M_S", 1e-3, "m/s", "Least speed of a slip; a slower one is creep.", "slope")
FROM_REST = _of(
    "FROM_REST",
    0.1,
    "share",
    "Largest share of its greatest speed at which a slip from rest begins.",
    "puck, pushed_box",
)
SLIPS_M = _of("SLIPS_M", 1e-3, "m", "Least length of a slip.", "what is to stay is asked by the mm")
SLIPS_SHARE = _of(
    "SLIPS_SHARE", 0.01, "share", "Least length of a slide over its body's size.", "slope"
)
SLIPS_STEPS = _of(
    "SLIPS_STEPS", 10, "1", "Least number of steps of a slide; an impact is shorter.", "crate"
)
NO_FORCE = _of(
    "NO_FORCE",
    0.01,
    "share",
    "Share of the normal force below which a force is negligible.",
    "pushbox",
)
LANDS_M_S = _of(
    "LANDS_M_S",
    0.02,
    "m/s",
    "Least speed along the normal at which a grip closes.",
    "grip",
)
GRIPPED = _of(
    "GRIPPED",
    0.1,
    "share",
    "Share of the normal forces that is left of their sum where they press from both sides.",
    "bar, panda_hold",
)
SLIDES = _of(
    "SLIDES",
    0.8,
    "share",
    "Least slip over the path of the centre; less is rolling or tumbling.",
    "a rolling ball",
)
TREMBLES_M_S = _of(
    "TREMBLES_M_S",
    1e-7,
    "m/s",
    "Least speed of a creep; a slower one is rounding.",
    "a box at rest",
)
CREEPS_M = _of("CREEPS_M", 1e-4, "m", "Least length of a creep.", "a crate creeps 0.17 mm in 9 s")
CREEPS_M_S = _of("CREEPS_M_S", 0.02, "m/s", "Largest speed of a creep.", "panda_hold")
CREEPS_USED = _of(
    "CREEPS_USED",
    0.9,
    "share",
    "Largest share of the friction available that a creep needs.",
    "panda_hold",
)
CREEPS_STEPS = _of(
    "CREEPS_STEPS",
    101,
    "1",
    "Least number of steps of a creep; shorter ones are coming to rest.",
    "stack",
)
CREEPS_STEADY = _of(
    "CREEPS_STEADY",
    10,
    "1",
    "Largest speed of a creep over its mean; faster ones are settling.",
    "stack",
)
CREEPS_STRAIGHT = _of(
    "CREEPS_STRAIGHT",
    0.5,
    "share",
    "Least net displacement over the path; less is trembling.",
    "turntable",
)
GAINED = _of(
    "GAINED", 0.01, "share", "Least gain of a contact over the energy that it was brought.", "lift"
)
DEEP_IMPACT = _of(
    "DEEP_IMPACT",
    0.2,
    "share",
    "Least overlap of an impact over the thinner body's shortest edge.",
    "deep",
)
DEEP_LASTING = _of(
    "DEEP_LASTING", 0.1, "share", "Least overlap that lasts, over the same edge.", "round2_dragging"
)
OVER_HALF = _of(
    "OVER_HALF",
    0.5,
    "share",
    "Least overlap, over the same edge, that is no longer physics.",
    "deep2",
)
IMPACT_STEPS = _of("IMPACT_STEPS", 4, "1", "Number of steps in which an impact is over.", "deep")
JUMPED = _of(
    "JUMPED",
    2.0,
    "1",
    "Overlap over what the approach gives in a step, above which it was placed.",
    "round2_more",
)
GROWS_STEPS = _of(
    "GROWS_STEPS", 10, "1", "Least number of steps in which something is pressed in.", "lift"
)
PRESSES = _of(
    "PRESSES",
    0.5,
    "share",
    "Least share of the contacts' impulses that the pressing force makes up.",
    "round2_dragging",
)
RATIO = _of(
    "RATIO",
    10.0,
    "1",
    "Ratio of masses beyond which the solver takes many iterations.",
    "deep_slop, rope_stiff",
)
MOST_RATIO = _of(
    "MOST_RATIO", 2e3, "1", "Ratio of masses beyond which it takes more than 500.", "tiny_and_heavy"
)
PYRAMID_M_S = _of("PYRAMID_M_S", 0.01, "m/s", "Least speed of a sliding body.", "pyramid")
PYRAMID = _of(
    "PYRAMID", 1.1, "1", "Friction over μN above which it is not that of a cone.", "pyramid"
)
PYRAMID_STEPS = _of(
    "PYRAMID_STEPS", 10, "1", "Least number of steps with such friction.", "pyramid"
)
PYRAMID_TURNS_RAD = _of(
    "PYRAMID_TURNS_RAD",
    0.2,
    "rad",
    "Least angle by which friction of more than μN turns a slide.",
    "a sled sent off at 20° slides at 0° in the end",
)
LONG_S = _of(
    "LONG_S",
    1 / 30,
    "s",
    "Longest timestep of a robot; a position motor closes a tenth of its gap in it.",
    "a body falls 11 mm in it",
)
ENDLESS_M = _of(
    "ENDLESS_M", 1e20, "m", "Least thickness of a box that counts as a plane.", "plane.urdf"
)
DAMPED = _of(
    "DAMPED",
    0.1,
    "share",
    "Least share of the energy of what nothing touches that damping takes.",
    "spring_constraint; in right scripts it is 1 to 8 %",
)
STOPS = _of(
    "STOPS", 0.5, "share", "Least share of the energy of what rolls that stops it.", "ball_stops"
)
UNBALANCED = _of(
    "UNBALANCED",
    0.1,
    "share",
    "Least sum on a sleeping body over its largest term.",
    "asleep",
)
PUSHED_APART_M_S = _of(
    "PUSHED_APART_M_S", 1e-2, "m/s", "Least speed at which bodies are pushed apart.", "placed"
)
STANDARD_M_S2 = _of(
    "STANDARD_M_S2", 9.81, "m/s²", "Gravity from which the height of a throw is computed.", "hollow"
)
STAYS = _of(
    "STAYS",
    0.5,
    "share",
    "Largest path over that of its support for a body that stays behind.",
    "teleport_platform",
)
AHEAD = _of(
    "AHEAD", 0.05, "share", "Least lead of a support over the body's size.", "teleport_platform"
)
BEYOND = _of("BEYOND", 0.01, "share", "Least excess over a limit of a file.", "limits")
SAME_SIGN = _of(
    "SAME_SIGN",
    0.9,
    "share",
    "Least sum of torques over that of their sizes, for torques that keep their sign.",
    "round2_ends",
)
DAMPS_STEADY = _of(
    "DAMPS_STEADY", 0.1, "share", "Least share of such torques that damping takes.", "damping"
)
DAMPS_ANY = _of(
    "DAMPS_ANY", 0.5, "share", "Least share of other torques that damping takes.", "damping"
)
MOVES = _of(
    "MOVES",
    0.05,
    "rad/s or m/s",
    "Least speed that must be given to a joint over the run to move it.",
    "gravcomp",
)
HOLDS = _of(
    "HOLDS",
    0.5,
    "share",
    "Least share of what acts on a joint that a motor cancels that holds it.",
    "pendulum",
)
ROLLS = _of(
    "ROLLS",
    0.005,
    "share",
    "Least torque about a wheel's axis over what presses its robot, times the wheel's radius.",
    "a car at rest has 0.0008, one on a slope of 0.1 rad 0.02",
)
NO_TERM = _of(
    "NO_TERM",
    1e-3,
    "share",
    "Share of the largest term below which a sum is what remains of others.",
    "gravcomp",
)
FOLLOWS = _of(
    "FOLLOWS", 0.01, "share", "Least gap of a joint that does not follow, over its range.", "mimic"
)
DRIFTS = _of("DRIFTS", 0.02, "share", "Least drift over the largest momentum.", "momentum")
OF_ALL_MOVED = _of(
    "OF_ALL_MOVED",
    0.1,
    "share",
    "Least momentum over what its parts have; where these cancel, what is left is small.",
    "momentum",
)
FREE_STEPS = _of(
    "FREE_STEPS", 11, "1", "Least number of steps in a row in which nothing acts.", "momentum"
)
WHEEL_SLIPS = _of(
    "WHEEL_SLIPS", 0.05, "share", "Least share of what wheels roll that slips.", "racecar"
)
WHEEL_TURN_RAD = _of(
    "WHEEL_TURN_RAD", 6.283185307179586, "rad", "Least rotation of a wheel: one turn.", "car"
)
WHEEL_LYING = _of(
    "WHEEL_LYING",
    0.5,
    "1",
    "Largest cosine between a wheel's axis and the ground's normal.",
    "wheels",
)
WHEEL_AT_LIMIT = _of(
    "WHEEL_AT_LIMIT", 0.95, "share", "Least share of μN of friction at its limit.", "racecar"
)
WHEEL_ALIKE = _of(
    "WHEEL_ALIKE", 0.95, "1", "Least cosine between normals of the same ground.", "a caster"
)
WHEEL_HELD = _of(
    "WHEEL_HELD",
    0.1,
    "share",
    "Least share of the friction available to the wheels with which something else holds a robot.",
    "wheels",
)
WHEEL_SIDEWAYS = _of(
    "WHEEL_SIDEWAYS",
    0.2,
    "share",
    "Least share of the slip that goes across a wheel that the robot's turn drags.",
    "skid_turn",
)
MINOR = _of(
    "MINOR",
    0.1,
    "share",
    "Share of the gravest finding below which one that is no mistake is folded away.",
    "of 51 findings beside the true cause 26 moved the outcome by less",
)
PUSHES_STEPS = _of(
    "PUSHES_STEPS",
    10,
    "1",
    "Least number of steps in which a force acts for each time that it was written.",
    "mujoco: push_stays; right_push writes it before each step",
)
MASS_EDIT = _of(
    "MASS_EDIT",
    2,
    "1",
    "Least factor between two masses at which the softness of contacts visibly changes.",
    "mujoco: mass_edited; depth under a load grows by the same factor",
)
OWN_SHARE = _of(
    "OWN_SHARE",
    0.01,
    "share",
    "Share of an actuator's force below which a force on its joint is negligible.",
    "rounding, and friction of contacts at rest",
)
SPRING_SHARE = _of(
    "SPRING_SHARE",
    0.05,
    "share",
    "Largest difference of a spring's force from kp times its gap.",
    "mujoco: soft_servo, whose kv acts while it settles",
)
DOUBLES = _of(
    "DOUBLES",
    2,
    "1",
    "Least factor from turn to turn of a joint that no law is known of.",
    "mujoco: own_pd_explodes; random actions do not double and double again",
)
HOPS_STEPS = _of(
    "HOPS_STEPS",
    50,
    "1",
    "Steps without contact after which a slide has ended; on soft contacts a body hops.",
    "mujoco: slides_down_the_ramp",
)
LOADED = _of(
    "LOADED",
    0.01,
    "share",
    "Least share of the friction that a body could have, or needs, that counts.",
    "a body at rest on a level floor needs none",
)
SLIDES_SHARE = _of(
    "SLIDES_SHARE",
    0.8,
    "share",
    "Least slip at the contact over the path of the centre; less is rolling or tumbling.",
    "a ball on a slope",
)
SLIDES_USED = _of(
    "SLIDES_USED",
    0.7,
    "share",
    "Least friction of a slide over what it could be; a pyramid's along its diagonals.",
    "worlds of MuJoCo: a block that rolls in a hand uses 0.36",
)
STRAIGHT = _of(
    "STRAIGHT",
    0.5,
    "share",
    "Least net displacement over the path; less is trembling.",
    "a box that settles",
)
AT_LIMIT_SHARE = _of(
    "AT_LIMIT_SHARE",
    0.9,
    "share",
    "Largest share of the friction available that a creep uses.",
    "mujoco: grasp_creeps, 10 %",
)
THROWN_M = _of(
    "THROWN_M",
    1e-3,
    "m",
    "Least height that the speed of parting gives.",
    "mujoco: starts_overlapping, 0.1 m; the overlap of a body at rest gives none",
)
SINKS_M = _of(
    "SINKS_M",
    5e-3,
    "m",
    "Least depth at which a body stays inside another.",
    "mujoco: soft_table, 11 mm",
)
CARRIES = _of(
    "CARRIES",
    20,
    "1",
    "Least load of a contact over the weight of the lighter body for that to be why it is deep.",
    "mujoco: crushed_box, 4,000; with 50 kg in place of 0.5 it is 5, and 0.4 mm",
)
SINKS_STEPS = _of(
    "SINKS_STEPS",
    100,
    "1",
    "Number of steps over which a depth or a lag is steady.",
    "mujoco: soft_table, mocap_lags",
)
STEADY_SHARE = _of(
    "STEADY_SHARE",
    0.1,
    "share",
    "Largest change of a depth, a lag or a speed that is steady.",
    "mujoco: mocap_lags",
)
LAG_SHARE = _of(
    "LAG_SHARE",
    0.25,
    "share",
    "Largest difference of a lag from what its time constant gives.",
    "mujoco: mocap_lags, 1 %",
)
WITHOUT_INERTIAL_KG = _of(
    "WITHOUT_INERTIAL_KG", 1, "kg", "Mass of a link whose file gives none.", "husky"
)
OTHER_INERTIA = _of(
    "OTHER_INERTIA", 0.1, "share", "Least share by which an inertia differs.", "inertia"
)
OTHER_INERTIA_MATTERS = _of(
    "OTHER_INERTIA_MATTERS",
    0.02,
    "share",
    "Least share of the impulses on a degree of freedom that the other inertia changes.",
    "default_motor_on_a_held_tool",
)
TURNS_RAD_S = _of(
    "TURNS_RAD_S",
    0.1,
    "rad/s or m/s",
    "Least rate of a body that turns; a slower one rests or rocks.",
    "reset",
)
KEPT = _of(
    "KEPT",
    1e-9,
    "m or rad",
    "Least distance that a call puts a body away from where it was.",
    "rounding",
)
TELEPORTED_M_S = _of(
    "TELEPORTED_M_S",
    1e-3,
    "m/s",
    "Least speed of a body that is put elsewhere while it moves.",
    "a reset",
)
SOON_STEPS = _of(
    "SOON_STEPS",
    10,
    "1",
    "Most steps between two pushes that were meant as one.",
    "oneforce: an action that is repeated for 4 steps",
)
NEGLIGIBLE = _of(
    "NEGLIGIBLE",
    0.01,
    "share",
    "Largest share, of the speed that a push gave or of the greatest, that is negligible.",
    "round2_kicks",
)
SAME_POINT_M = _of(
    "SAME_POINT_M",
    1e-6,
    "m",
    "Largest distance of a push from the place where it was meant.",
    "rounding",
)
HULL_OFF_M = _of(
    "HULL_OFF_M", 3e-3, "m", "Least distance of a touch from a surface.", "margins of shapes"
)
HULL_EVERY = _of(
    "HULL_EVERY", 8, "1", "One of so many steps is examined, as a touch lasts.", "hollow"
)

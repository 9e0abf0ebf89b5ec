"""All thresholds of the rules, with units and meanings.

`drop explain` shows them; `sources` parses these docstrings. The unit `share` is a ratio to the
quantity in the sentence, `1` a count or ratio. `Needed by` names the test script, or the reason,
that fixes the value.
"""

from __future__ import annotations

AT_TARGET_RAD = 1e-2
"""Distance from its target below which a joint has reached it. Unit: rad. Needed by: 0.01 rad is
half a degree."""
AT_TARGET_M = 1e-3
"""Distance from its target below which a sliding joint has reached it. Unit: m. Needed by: a
gripper's finger."""
BEYOND_RANGE = 0.01
"""Least share of a joint's range by which a target lies beyond it. Unit: share. Needed by: limits
that files round."""
OTHER_FORCE = 0.01
"""Largest difference of a force from the one that was given. Unit: share. Needed by: rounding of
impulses."""
CROSSINGS = 3
"""Least number of steps in which a joint passes its target, or of targets that it follows. Unit: 1.
Needed by: a joint that passes it once or twice overshoots for another reason."""
IN_DEGREES_RAD = 6.283185307179586
"""Greatest target of a joint that is taken as radians. Unit: rad. Needed by:
panda_degrees."""
COASTS_RAD_S = 1e-2
"""Least rate at which a joint without a motor coasts. Unit: rad/s. Needed by: crane_drift."""
COASTS_STEPS = 10
"""Least number of steps in which a joint does not move as its file or a call requests. Unit: 1.
Needed by: crane_drift, spherical."""
SCALE = 2
"""Least factor, up or down, by which a body is scaled. Unit: 1. Needed by: tiny_and_heavy."""
FRAME_APART_M = 1e-3
"""Least distance of a centre of mass from its file's origin that matters to a reset. Unit: m.
Needed by: base_com."""
LEFT_M = 1e-2
"""Least distance of a body that has left its place. Unit: m. Needed by: mass_for_all."""
TIPS_RAD = 0.5
"""Least angle by which an arm's base tips over. Unit: rad. Needed by: no_fixed_base, 1.5 rad."""
EACH_STEP = 0.9
"""Least share of the steps that counts as every step. Unit: share. Needed by: float_off_edge."""
FALLS_STEPS = 5
"""Least number of steps in flight before which a velocity was set. Unit: 1. Needed by:
float_off_edge."""
HALF_THE_STEPS = 0.5
"""Least share of the steps from the first call on in which a pose is set step by step. Unit: share.
Needed by: reset_joint_each."""
DEEP_M = 1e-3
"""Largest overlap of bodies that are pressed together by contact forces alone. Unit: m. Needed by:
reset_joint_each."""
OVERLAPS_STEPS = 5
"""Least number of steps with such an overlap. Unit: 1. Needed by: reset_joint_each."""
SAME_GAP = 0.05
"""Largest change of the gap between a body and the targets set from it. Unit: share. Needed by:
lift_by_constraint."""
STALE_M = 1e-3
"""Least distance that a link moves in one step, which is the error of its outdated pose. Unit: m.
Needed by: link_stale."""
BOUNCES_M_S = 0.2
"""Bullet's own threshold: slower contacts do not bounce. Unit: m/s. Needed by:
btContactSolverInfo.h, m_restitutionVelocityThreshold."""
PLACED_M_S = 9.81 / 60
"""Speed below which a body was placed, not dropped. Unit: m/s. Needed by: right_placed: what
gravity gives it in 1/60 s."""
SOFTLY = 0.5
"""Least share of the approach speed that a soft contact leaves after one step. Unit: share. Needed
by: contacts with a stiffness of their own."""
SWALLOWED = 0.5
"""Share of the requested rebound below which a body does not bounce. Unit: share. Needed by:
overlap alone lifts a little."""
USUAL_STIFFNESS_HZ = 24
"""Share of a gap that PyBullet's default positionGain of 0.1 closes per second, at a timestep of
1/240 s. Unit: 1/s. Needed by: fine_timestep."""
STIFF = 2
"""Least ratio of this rate to the default one for a gain too stiff for a motor's force. Unit: 1.
Needed by: fine_timestep, 20."""
SMALL_GAIN = 0.05
"""Largest positionGain that counts as small; PyBullet's is 0.1. Unit: share. Needed by: slow
arms."""
LAWFUL_GAP = 0.1
"""Largest relative difference between a gap and the one that the motor's control law leaves. Unit:
share. Needed by: targets that change with every step."""
LIMITED_OFTEN = 0.1
"""Least share of steps with a motor at its limit for the limit to be the cause. Unit: share. Needed
by: targets that change with every step."""
SLOW = 0.5
"""Share of a velocity motor's target, below which its joint is too slow. Unit: share. Needed by: a
wheel that starts."""
RINGS_STEPS = 8
"""Least number of steps in a row in which a rate changes its sign. Unit: 1. Needed by: chatter:
kuka's joint damping."""
RINGS_LEAST = 1e-2
"""Rate below which a joint's changes of sign are noise. Unit: rad/s or m/s. Needed by: robots at
rest."""
RINGS_SHARE = 0.01
"""Rate, relative to the joint's highest rate, below which changes of sign are noise. Unit: share.
Needed by: robots at rest."""
SWITCHES = 1e-6
"""Largest change in magnitude of forces that only change their sign. Unit: share. Needed by: a
pendulum that is driven by ±2 N m."""
TURNS_MOST = 0.5
"""Least share of one term in the impulses that reverse a rate. Unit: share. Needed by:
self_tremble."""
TURNS_TOO = 0.1
"""Least share of a motor in the impulses that reverse a rate for its gains to be the cause. Unit:
share. Needed by: gain_silent."""
HAND_M = 5e-3
"""Distance below which an end effector counts as at its requested point. Unit: m. Needed by:
ik_out_of_reach."""
IK_JOINTS = 0.2
"""Largest share of an end effector's error that comes from joints off their targets. Unit: share.
Needed by: a weak arm."""
IK_AGAIN = 50
"""Number of successive solutions for one point after which the point counts as out of reach. Unit:
1. Needed by: ik_out_of_reach."""
IK_ENOUGH = 1000
"""Number of iterations beyond which more hardly help. Unit: 1. Needed by: kuka, panda."""
EPISODE_STEPS = 10
"""Least number of steps of an episode: shorter ones are animations by resets. Unit: 1. Needed by:
right scripts that animate."""
EPISODES_MOST = 20
"""Number of episodes of one kind that are compared: differences appear in the first ones. Unit: 1.
Needed by: reading a recording again takes its time."""
BACK = 1e-6
"""Distance from an earlier position within which a call counts as restoring a joint's position.
Unit: rad or m. Needed by: reset; one that is put there with noise is not."""
WATCHED = 240
"""Number of steps for which a joint is examined after a keyframe has set its position. Unit: 1.
Needed by: mujoco: keyframe_ctrl."""
APART = 0.05
"""Least distance of the points that a constraint joins, over the smaller body's size. Unit: share.
Needed by: apart."""
APART_RAD = 0.05
"""Least angle between the frames that a constraint joins. Unit: rad. Needed by:
constraint_turned."""
CLOSES = 0.5
"""Largest share of a constraint's first gap that remains after ten steps: a spring leaves more.
Unit: share. Needed by: spring_constraint."""
STILL_M_S = 1e-3
"""Speed below which a side of a constraint stays where it is. Unit: m/s. Needed by: weak."""
PULLED_BACK = 0.99
"""Least share of a gap that remains after ten steps if nothing closes the gap. Unit: share. Needed
by: pendulums that hang there swing."""
SLIPS_M_S = 1e-3
"""Least speed of a slip; a slower one is creep. Unit: m/s. Needed by: slope."""
FROM_REST = 0.1
"""Largest share of its greatest speed at which a slip from rest begins. Unit: share. Needed by:
puck, pushed_box."""
SLIPS_M = 1e-3
"""Least length of a slip. Unit: m. Needed by: what is to stay is asked by the mm."""
SLIPS_SHARE = 0.01
"""Least length of a slide over its body's size. Unit: share. Needed by: slope."""
SLIPS_STEPS = 10
"""Least number of steps of a slide; an impact is shorter. Unit: 1. Needed by: crate."""
NO_FORCE = 0.01
"""Share of the normal force below which a force is negligible. Unit: share. Needed by: pushbox."""
LANDS_M_S = 0.02
"""Least speed along the normal at which a grip closes. Unit: m/s. Needed by: grip."""
GRIPPED = 0.1
"""Largest ratio of the vector sum of normal forces to the sum of their magnitudes in a grip. Unit:
share. Needed by: bar, panda_hold."""
SLIDES = 0.8
"""Least slip over the path of the centre; less is rolling or tumbling. Unit: share. Needed by: a
rolling ball."""
TREMBLES_M_S = 1e-7
"""Least speed of a creep; a slower one is rounding. Unit: m/s. Needed by: a box at rest."""
CREEPS_M = 1e-4
"""Least length of a creep. Unit: m. Needed by: a crate creeps 0.17 mm in 9 s."""
CREEPS_M_S = 0.02
"""Largest speed of a creep. Unit: m/s. Needed by: panda_hold."""
CREEPS_USED = 0.9
"""Largest share of the friction available that a creep needs. Unit: share. Needed by:
panda_hold."""
CREEPS_STEPS = 101
"""Least number of steps of a creep; shorter ones are coming to rest. Unit: 1. Needed by: stack."""
CREEPS_STEADY = 10
"""Largest speed of a creep over its mean; faster ones are settling. Unit: 1. Needed by: stack."""
CREEPS_STRAIGHT = 0.5
"""Least net displacement over the path; less is trembling. Unit: share. Needed by: turntable."""
GAINED = 0.01
"""Least energy gained in a contact, relative to the energy before it. Unit: share. Needed by:
lift."""
DEEP_IMPACT = 0.2
"""Least overlap of an impact over the thinner body's shortest edge. Unit: share. Needed by:
deep."""
DEEP_LASTING = 0.1
"""Least lasting overlap over the thinner body's shortest edge. Unit: share. Needed by:
round2_dragging."""
OVER_HALF = 0.5
"""Least overlap over the thinner body's shortest edge that is no longer physical. Unit: share.
Needed by: deep2."""
IMPACT_STEPS = 4
"""Number of steps in which an impact is over. Unit: 1. Needed by: deep."""
JUMPED = 2.0
"""Ratio of an overlap to the approach in one step, above which the bodies were placed that way.
Unit: 1. Needed by: round2_more."""
GROWS_STEPS = 10
"""Least number of steps in which a body is pressed into another. Unit: 1. Needed by: lift."""
PRESSES = 0.5
"""Least share of the contacts' impulses that the pressing force makes up. Unit: share. Needed by:
round2_dragging."""
RATIO = 10.0
"""Ratio of masses beyond which the solver takes many iterations. Unit: 1. Needed by: deep_slop,
rope_stiff."""
MOST_RATIO = 2e3
"""Ratio of masses beyond which the solver takes more than 500 iterations. Unit: 1. Needed by:
tiny_and_heavy."""
PYRAMID_M_S = 0.01
"""Least speed of a sliding body. Unit: m/s. Needed by: pyramid."""
PYRAMID = 1.1
"""Friction over μN above which it is not that of a cone. Unit: 1. Needed by: pyramid."""
PYRAMID_STEPS = 10
"""Least number of steps with such friction. Unit: 1. Needed by: pyramid."""
PYRAMID_TURNS_RAD = 0.2
"""Least angle by which friction of more than μN turns a slide. Unit: rad. Needed by: a sled sent
off at 20° slides at 0° in the end."""
LONG_S = 1 / 30
"""Longest timestep of a robot; a position motor closes a tenth of its gap in it. Unit: s. Needed
by: a body falls 11 mm in it."""
ENDLESS_M = 1e20
"""Least thickness of a box that counts as a plane. Unit: m. Needed by: plane.urdf."""
DAMPED = 0.1
"""Least share of the energy of a body without contact that damping takes. Unit: share. Needed by:
spring_constraint; in right scripts it is 1 to 8 %."""
STOPS = 0.5
"""Least share of a rolling body's energy that rolling friction takes. Unit: share. Needed by:
ball_stops."""
ROLLS_M_S = 0.01
"""Least speed of a rolling body. Unit: m/s. Needed by: a box that trembles in a grip."""
UNBALANCED = 0.1
"""Least sum of forces on a sleeping body over the largest of these forces. Unit: share. Needed by:
asleep."""
PUSHED_APART_M_S = 1e-2
"""Least speed at which bodies are pushed apart. Unit: m/s. Needed by: placed."""
STANDARD_M_S2 = 9.81
"""Gravity from which the height of a throw is computed. Unit: m/s². Needed by: hollow."""
STAYS = 0.5
"""Largest path over that of its support for a body that stays behind. Unit: share. Needed by:
teleport_platform."""
AHEAD = 0.05
"""Least lead of a support over the body's size. Unit: share. Needed by: teleport_platform."""
BEYOND = 0.01
"""Least excess over a limit of a file. Unit: share. Needed by: limits."""
SAME_SIGN = 0.9
"""Least ratio of the sum of torques to the sum of their magnitudes, for torques that keep their
sign. Unit: share. Needed by: round2_ends."""
DAMPS_STEADY = 0.1
"""Least share of torques with a constant sign that damping takes. Unit: share. Needed by:
damping."""
DAMPS_ANY = 0.5
"""Least share of other torques that damping takes. Unit: share. Needed by: damping."""
MOVES = 0.05
"""Least rate that the impulses of a run would give a joint for them to matter. Unit: rad/s or m/s.
Needed by: gravcomp."""
HOLDS = 0.5
"""Least share of the forces on a joint that a motor must cancel to count as holding the joint.
Unit: share. Needed by: pendulum."""
NO_TERM = 1e-3
"""Share of the largest term below which a sum of terms is negligible. Unit: share. Needed by:
gravcomp."""
ROLLS = 0.005
"""Least torque of contacts that rolls a wheel, over the robot's weight times the wheel's radius.
Unit: share. Needed by: a robot that stands, 0.001; one on a slope of 2 degrees, 0.009."""
FOLLOWS = 0.01
"""Least gap of a joint that does not follow, over its range. Unit: share. Needed by: mimic."""
DRIFTS = 0.02
"""Least drift over the largest momentum. Unit: share. Needed by: momentum."""
OF_ALL_MOVED = 0.1
"""Least ratio of a momentum to the sum of its parts' magnitudes, since parts may cancel. Unit:
share. Needed by: momentum."""
FREE_STEPS = 11
"""Least number of steps in a row in which nothing acts. Unit: 1. Needed by: momentum."""
WHEEL_SLIPS = 0.05
"""Least share of a wheel's path that is slip. Unit: share. Needed by: racecar."""
WHEEL_TURN_RAD = 6.283185307179586
"""Least rotation of a wheel: one turn. Unit: rad. Needed by: car."""
WHEEL_LYING = 0.5
"""Largest cosine between a wheel's axis and the ground's normal. Unit: 1. Needed by: wheels."""
WHEEL_AT_LIMIT = 0.95
"""Least share of μN of friction at its limit. Unit: share. Needed by: racecar."""
WHEEL_ALIKE = 0.95
"""Least cosine between normals of the same ground. Unit: 1. Needed by: a caster."""
WHEEL_HELD = 0.1
"""Least share of the friction available to the wheels with which something else holds a robot.
Unit: share. Needed by: wheels."""
ROLLING = 1e-4
"""Rolling friction that MuJoCo gives each geometry by itself. Unit: m. Needed by: mujoco:
rolls_on."""
ROLLS_SLIP = 0.1
"""Largest slip speed over the speed of a rolling body. Unit: share. Needed by: mujoco: rolls_on."""
GATHERS = 2
"""Least ratio of a body's velocity to the velocity of the poses that calls set. Unit: 1. Needed by:
mujoco: held_by_qpos."""
STEEP = 2
"""Slope beyond which a body leans on another, or falls along it, and does not lie on it. Unit: 1.
Needed by: mujoco: right_dominoes."""
USUAL_FRICTION = 0.5
"""PyBullet's default coefficient of friction. Unit: 1. Needed by: slide_on_purpose."""
TAKES_DRIVE = 0.8
"""Least share of a joint's drive that damping, dry friction or armature takes. Unit: share. Needed
by: mujoco: door_damped, stiction_in_the_joint, sluggish_rotor."""
SLOW_RAD_S = 1
"""Rate that a slow joint never reaches. Unit: rad/s. Needed by: mujoco: a wheel against its own
damping is driven faster."""
SLOW_M_S = 0.02
"""Speed that a slow sliding joint never reaches. Unit: m/s. Needed by: mujoco: grip_too_weak, whose
fingers close at 0.03 m/s."""
SLOWED = 10
"""Least factor by which a slow joint would be faster without damping, dry friction or armature.
Unit: 1. Needed by: mujoco: a finger whose rotor has as much inertia as itself."""
MINOR = 0.1
"""Share of the gravest finding, or of a larger gap, below which an observation is minor. Unit:
share. Needed by: of 51 findings beside the true cause 26 moved the outcome by less."""
PUSHES_STEPS = 10
"""Least number of steps in which a force acts for each time that it was written. Unit: 1. Needed
by: mujoco: push_stays; right_push writes it before each step."""
MASS_EDIT = 2
"""Least factor between two masses at which the softness of contacts visibly changes. Unit: 1.
Needed by: mujoco: mass_edited; depth under a load grows by the same factor."""
OWN_SHARE = 0.01
"""Share of an actuator's force below which a force on its joint is negligible. Unit: share. Needed
by: rounding, and friction of contacts at rest."""
SPRING_SHARE = 0.05
"""Largest difference of a spring's force from kp times its gap. Unit: share. Needed by: mujoco:
soft_servo, whose kv acts while it settles."""
DOUBLES = 2
"""Least growth factor from one reversal to the next for a joint with an unknown control law. Unit:
1. Needed by: mujoco: own_pd_explodes; random actions do not double and double again."""
GROWN = 10
"""Least total growth over such reversals if the steps stay explained. Unit: 1. Needed by: a script
that tries its motor out."""
SAGS = 5
"""Least ratio of a spring's gap to the tolerance for joints at their target that counts as a
mistake. Unit: 1. Needed by: arms and lifts whose gains are usual: mujoco: pressed_by_gripper sags
by 2.9 mm."""
HOPS_STEPS = 50
"""Steps without contact after which a slide has ended; on soft contacts a body hops. Unit: 1.
Needed by: mujoco: slides_down_the_ramp."""
LOADED = 0.01
"""Least share of the friction that a body could have, or needs, that counts. Unit: share. Needed
by: a body at rest on a level floor needs none."""
SLIDES_SHARE = 0.8
"""Least slip at the contact over the path of the centre; less is rolling or tumbling. Unit: share.
Needed by: a ball on a slope."""
SLIDES_USED = 0.7
"""Least ratio of friction to the possible friction in a slide; a pyramid's is least on diagonals.
Unit: share. Needed by: worlds of MuJoCo: a block that rolls in a hand uses 0.36."""
STRAIGHT = 0.5
"""Least net displacement over the path; less is trembling. Unit: share. Needed by: a box that
settles."""
AT_LIMIT_SHARE = 0.9
"""Largest share of the friction available that a creep uses. Unit: share. Needed by: mujoco:
grasp_creeps, 10 %."""
THROWN_M = 1e-3
"""Least height that a body thrown with the separation speed reaches. Unit: m. Needed by: mujoco:
starts_overlapping, 0.1 m; the overlap of a body at rest gives none."""
SINKS_M = 5e-3
"""Least depth at which a body stays inside another. Unit: m. Needed by: mujoco: soft_table, 11
mm."""
CARRIES = 20
"""Least ratio of a contact's load to the lighter body's weight for the load to explain the depth.
Unit: 1. Needed by: mujoco: crushed_box, 4,000; with 50 kg in place of 0.5 it is 5, and 0.4 mm."""
SINKS_STEPS = 100
"""Number of steps over which a depth or a lag is steady. Unit: 1. Needed by: mujoco: soft_table,
mocap_lags."""
STEADY_SHARE = 0.1
"""Largest change of a depth, a lag or a speed that is steady. Unit: share. Needed by: mujoco:
mocap_lags."""
LAG_SHARE = 0.25
"""Largest relative difference between a lag and the one that the time constant predicts. Unit:
share. Needed by: mujoco: mocap_lags, 1 %."""
WITHOUT_INERTIAL_KG = 1
"""Mass of a link whose file gives none. Unit: kg. Needed by: husky."""
OTHER_INERTIA = 0.1
"""Least share by which an inertia differs. Unit: share. Needed by: inertia."""
OTHER_INERTIA_MATTERS = 0.02
"""Least share of the impulses on a degree of freedom that the other inertia changes. Unit: share.
Needed by: default_motor_on_a_held_tool."""
TURNS_RAD_S = 0.1
"""Least rate of a body that turns; a slower one rests or rocks. Unit: rad/s or m/s. Needed by:
reset."""
KEPT = 1e-9
"""Least distance by which a call changes a body's position. Unit: m or rad. Needed by: rounding."""
TELEPORTED_M_S = 1e-3
"""Least speed of a body that is put elsewhere while it moves. Unit: m/s. Needed by: a reset."""
SOON_STEPS = 10
"""Most steps between two pushes that were meant as one. Unit: 1. Needed by: oneforce: an action
that is repeated for 4 steps."""
NEGLIGIBLE = 0.01
"""Largest share, of the speed that a push gave or of the greatest, that is negligible. Unit: share.
Needed by: round2_kicks."""
SAME_POINT_M = 1e-6
"""Largest distance of a push from the place where it was intended. Unit: m. Needed by: rounding."""
HULL_OFF_M = 3e-3
"""Least distance of a contact point from a mesh's surface. Unit: m. Needed by: margins of
shapes."""
HULL_EVERY = 8
"""Interval of examined steps, since contacts last. Unit: 1. Needed by: hollow."""
CHATTERS = 0.5
"""Least share of the steps with a control beyond its range in which it changes its sign. Unit:
share. Needed by: a wheel whose gain times the timestep is 20 times its inertia."""
LITTLE_MASS = 0.25
"""Share of the moving mass below which links without `<inertial>` are a note. Unit: share. Needed
by: husky, whose 6 kg of 50 kg are frames."""

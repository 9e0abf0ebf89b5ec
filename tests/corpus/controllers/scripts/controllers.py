"""Controllers of six robots, each as it works, or with one thing wrong.

    python controllers.py ROBOT [FAULT]

Gymnasium's Hopper, Ant, Humanoid and HalfCheetah, a quadruped and a gripper; one episode each. Gains
and gaits were found by hand and by a random search, without a fault.
"""

import sys

import gymnasium
import mujoco
import numpy as np

robot, fault = sys.argv[1], "".join(sys.argv[2:3])

LEG = """<body name="{0}_thigh" pos="{1} {2} 0"><joint name="{0}_hip" axis="1 0 0"/>
<joint name="{0}_thigh" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.18" size="0.02" mass="0.6" contype="0" conaffinity="0"/>
<body name="{0}_calf" pos="0 0 -0.18"><joint name="{0}_calf" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.18" size="0.015" mass="0.15" contype="0" conaffinity="0"/>
<geom name="{0}_foot" type="sphere" pos="0 0 -0.18" size="0.022" mass="0.05"/></body></body>"""
LEGS = ("FL", 0.18, 0.13), ("FR", 0.18, -0.13), ("RL", -0.18, 0.13), ("RR", -0.18, -0.13)
JOINTS = [f"{leg[0]}_{joint}" for leg in LEGS for joint in ("hip", "thigh", "calf")]
QUADRUPED = f"""<mujoco model="quadruped"><option timestep="0.004"/>
<default><joint damping="1" armature="0.02"/><geom friction="0.8"/>
<position kp="80" kv="2" ctrlrange="-2 2" forcerange="-25 25"/></default>
<worldbody><geom name="floor" type="plane" size="20 20 1"/>
<body name="trunk" pos="0 0 0.32"><freejoint/>
<geom name="trunk" type="box" size="0.2 0.1 0.05" mass="7"/>
{"".join(LEG.format(*leg) for leg in LEGS)}</body></worldbody>
<actuator>{"".join(f'<position name="{j}" joint="{j}"/>' for j in JOINTS)}</actuator></mujoco>"""
GRIPPER = """<mujoco model="gripper"><option timestep="0.002" cone="elliptic" impratio="10"/>
<worldbody><geom name="table" type="plane" size="1 1 1"/>
<body name="cube" pos="0 0 0.02"><freejoint/>
<geom name="cube" type="box" size="0.02 0.02 0.02" mass="0.2" friction="0.7"/></body>
<body name="hand" pos="0 0 0.25" gravcomp="1"><joint name="lift" type="slide" axis="0 0 1"/>
<geom type="box" size="0.08 0.03 0.02" mass="0.5" contype="0" conaffinity="0"/>
<body name="left" pos="0.05 0 0" gravcomp="1"><joint name="left" type="slide" axis="-1 0 0" damping="2"/>
<geom name="left_pad" type="box" size="0.008 0.02 0.03" pos="0 0 -0.08" mass="0.1" friction="0.7"/></body>
<body name="right" pos="-0.05 0 0" gravcomp="1"><joint name="right" type="slide" axis="1 0 0" damping="2"/>
<geom name="right_pad" type="box" size="0.008 0.02 0.03" pos="0 0 -0.08" mass="0.1" friction="0.7"/></body>
</body></worldbody>
<actuator><position name="lift" joint="lift" kp="2000" kv="100" ctrlrange="-0.2 0.2"/>
<position name="left" joint="left" kp="400" kv="10" ctrlrange="0 0.04" forcerange="-20 20"/>
<position name="right" joint="right" kp="400" kv="10" ctrlrange="0 0.04" forcerange="-20 20"/></actuator>
</mujoco>"""


class Own(gymnasium.Env):
    """A robot of ours, which fails where its trunk, or what it carries, is too low."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))

    def __init__(self, xml, pose, frame_skip, fails):
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.pose, self.frame_skip, self.fails = pose, frame_skip, fails
        ranges = self.model.actuator_ctrlrange.astype(np.float32)
        self.action_space = gymnasium.spaces.Box(ranges[:, 0], ranges[:, 1])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[7 : 7 + len(self.pose)] = self.pose
        return self.observed(), {}

    def observed(self):
        return np.concatenate((self.data.qpos, self.data.qvel))

    def step(self, action):
        x = self.data.qpos[0]
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, self.frame_skip)
        fell = bool(self.fails(self.data))
        return self.observed(), self.data.qpos[0] - x, fell, False, {"fell": fell}


# -- the controllers: an action for an observation and a time --------------------------------------


def hopper(seen, _):
    """Stand: a PD law of each joint, and the torso's pitch and speed to thigh and foot."""
    pitch, joints = seen[1], seen[2:5]
    speed, turning, rates = seen[5], seen[7], seen[8:11]
    action = 0.6 * (np.array([0.51, 0.762, 0.186]) - joints) - 3.697 * rates
    action[0] += -24.362 * pitch + 0.489 * turning - 0.67 * speed
    action[2] += -6.913 * pitch - 2.701 * turning - 4.148 * speed
    return action


REST = np.array([0, 1, 0, -1, 0, -1, 0, 1])
BY_ACTUATOR = [6, 7, 0, 1, 2, 3, 4, 5]


def ant(seen, time_s):
    """Walk: swing hips and ankles, opposite legs together."""
    joints, rates = seen[5:13], seen[19:27]
    phase = 2 * np.pi * 1.938 * time_s + np.array([0, np.pi, 0, np.pi])
    target = 0.856 * REST
    target[::2] += np.array([0.902, 0.592, 0.333, 0.074]) * np.sin(phase)
    swing = np.array([0.779, -0.239, -0.646, 0.325]) * np.sin(phase - 0.303)
    target[1::2] += REST[1::2] * swing
    action = 1.166 * (target - joints) - 0.113 * rates
    return action if fault == "order" else action[BY_ACTUATOR]


GAIT = np.array([
    [0.589, 0.155, 0.381, 0.315, 0.67, 0.181],
    [-0.551, 1.035, 2.148, 2.98, 3.218, 4.652],
    [-0.321, -0.599, -0.067, -0.253, 0.004, 0.127],
])  # fmt: skip


def cheetah(seen, time_s):
    """Run: each joint follows a sine of its own."""
    size, phase, middle = GAIT
    target = size * np.sin(2 * np.pi * 3.156 * time_s + phase) + middle
    return 1.506 * (target - seen[2:8]) - 0.048 * seen[11:17]


POSE = dict(right_hip_y=-0.318, left_hip_y=-0.318, right_knee=-0.306, left_knee=-0.306,
            right_hip_x=0.04, left_hip_x=0.04, abdomen_y=-0.148)  # fmt: skip


def humanoid(seen, _):
    """Stand: a pose, and pitch, roll and speed of the torso to abdomen and hips."""
    model = env.unwrapped.model
    names = [model.actuator(k).name for k in range(model.nu)]
    places = [model.joint(name).qposadr[0] - 7 for name in names]
    joints, rates = seen[5:22][places], seen[28:45][places]
    w, x, y, z = seen[1:5]
    pitch, roll, turning = 2 * (w * y - z * x), 2 * (w * x + y * z), seen[25:28]
    pose = np.array([POSE.get(name, 0.0) for name in names])
    torque = dict(zip(names, 276 * (pose - joints) + 0.64 * rates))
    for name in ("left_hip_y", "right_hip_y"):
        torque[name] += 49.4 * pitch + 14.19 * turning[1] + 4.27 * seen[22]
    torque["abdomen_y"] += 148.5 * pitch - 11.32 * turning[1] + 39.3 * seen[22]
    sideways = -224 * roll + 10.17 * turning[0] - 25.88 * seen[23]
    torque["right_hip_x"] += sideways
    torque["left_hip_x"] -= sideways
    return np.array([torque[name] for name in names]) / GEARS


def quadruped(_, time_s):
    """Trot: diagonal legs together, by the targets of position servos."""
    target = np.tile([0, 0.7, -1.4], 4)
    phase = 2 * np.pi * 2 * time_s + np.array([0, np.pi, np.pi, 0])
    lifts = np.maximum(0, np.cos(phase))
    target[1::3] -= 0.15 * np.sin(phase) + 0.18 * lifts
    target[2::3] -= 0.35 * lifts
    return target


def gripper(_, time_s):
    """Go down, close, lift, hold."""
    down = 0.13 * np.clip(time_s / 0.4, 0, 1)
    up = 0.12 * np.clip((time_s - 1.0) / 0.5, 0, 1)
    closed = 0.03 * np.clip((time_s - 0.5) / 0.3, 0, 1)
    return np.array([up - down, closed, closed])


# -- what is wrong ---------------------------------------------------------------------------------


def in_the_model(model):
    """Change the robot."""
    if fault == "weak":
        model.actuator_gear[:] *= 0.3
    elif fault == "weak-knee":
        model.actuator_gear[model.actuator("left_knee").id] *= 0.05
    elif fault == "heavy":
        model.body_mass[:] *= 2
        model.body_inertia[:] *= 2
    elif fault == "heavy-cube":
        model.body_mass[model.body("cube").id] *= 20
    elif fault == "slippery":
        model.geom_friction[:, 0] *= 0.05
    elif fault == "soft":
        model.actuator_gainprm[:, 0] *= 0.1
        model.actuator_biasprm[:, 1] *= 0.1
    elif fault == "damped":
        model.dof_damping[6 if robot == "ant" else 3 :] *= 20
    elif fault == "limited":
        model.actuator_forcerange[:] *= 0.1


def to_the_robot(action, before):
    """Return the action that arrives."""
    if fault == "delay":
        return before
    if fault == "swapped":
        action = action.copy()
        action[[0, 1]] = action[[1, 0]]
    elif fault == "legs-swapped":
        return np.concatenate((action[3:6], action[:3], action[6:]))
    elif fault == "reversed":
        return action[::-1].copy()
    elif fault == "clamped":
        return np.clip(action, -0.1, 0.1)
    elif fault == "sign":
        action = action.copy()
        action[-1] *= -1
    elif fault == "scaled":
        return action * 0.2
    return action


MADE = {
    "hopper": lambda: gymnasium.make("Hopper-v5", max_episode_steps=200),
    "ant": lambda: gymnasium.make("Ant-v5", max_episode_steps=120),
    "humanoid": lambda: gymnasium.make("Humanoid-v5", max_episode_steps=100),
    "cheetah": lambda: gymnasium.make("HalfCheetah-v5", max_episode_steps=100),
    "quadruped": lambda: gymnasium.wrappers.TimeLimit(
        Own(QUADRUPED, np.tile([0, 0.7, -1.4], 4), 5, lambda d: d.qpos[2] < 0.18), 150
    ),
    "gripper": lambda: gymnasium.wrappers.TimeLimit(
        Own(GRIPPER, [], 10, lambda d: d.time > 1.4 and d.qpos[2] < 0.05), 110
    ),
}

env = MADE[robot]()
controller = globals()[robot]
GEARS = env.unwrapped.model.actuator_gear[:, 0].copy()
in_the_model(env.unwrapped.model)
seen, _ = env.reset(seed=1)
low, high = env.action_space.low, env.action_space.high
before, late = np.zeros(len(low)), [seen] * 6
timestep_s = env.unwrapped.model.opt.timestep * env.unwrapped.frame_skip
total, time_s, ended = 0.0, 0.0, False
while not ended:
    action = np.clip(controller(late[0] if fault == "stale" else seen, time_s), low, high)
    seen, reward, terminated, truncated, _ = env.step(to_the_robot(action, before))
    before, late = action, [*late[1:], seen]
    total, time_s, ended = total + reward, time_s + timestep_s, terminated or truncated
print(f"{robot} {fault}: return {total:.1f} in {time_s:.2f} s, terminated {terminated}")

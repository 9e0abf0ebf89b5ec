"""The first action of every episode seems to be lost, gym like env."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="2"/>
 <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="1"/></body></worldbody>
<actuator><position joint="shoulder" kp="400"/></actuator></mujoco>"""
class Env:
    def __init__(self):
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
    def reset(self):
        self.apply(np.array([-0.8]))
        if FIX:
            mujoco.mj_resetData(self.model, self.data)
            self.apply(np.array([-0.8]))
        else:
            mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        return self.data.qpos.copy()
    def apply(self, action):
        self.data.ctrl[:] = action
    def step(self):
        mujoco.mj_step(self.model, self.data, nstep=5)
        return self.data.qpos.copy()
env = Env()
obs = env.reset()
for _ in range(200):
    obs = env.step()
print(obs)

"""My own PD controller shakes, although the gains are those of the real robot."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="{dt}"{opt}/><worldbody><body pos="0 0 1"><joint name="wrist" axis="1 0 0" damping="{damp}" armature="{arm}"/>
  <geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/></body></worldbody>
<actuator>{act}</actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(
    XML.format(dt=0.002, opt="", damp=0, arm=0, act='<motor name="wrist" joint="wrist"/>')
)
data = mujoco.MjData(model)
kp, kd = (0.5, 0.001) if FIX else (20.0, 0.01)
resets, before = 0, 0.0
for _ in range(1000):
    data.ctrl[:] = kp * (0.1 - data.qpos) - kd * data.qvel
    mujoco.mj_step(model, data)
    resets, before = resets + (data.time < before), data.time
print("resets:", resets, "angle:", data.qpos)

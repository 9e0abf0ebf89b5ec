"""WARNING: Nan, Inf or huge value in QACC at DOF 0. Why?"""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="{dt}"{opt}/><worldbody><body pos="0 0 1"><joint name="wrist" axis="1 0 0" damping="{damp}" armature="{arm}"/>
  <geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/></body></worldbody>
<actuator>{act}</actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(
    XML.format(
        dt=0.002,
        opt="",
        damp=0,
        arm=0,
        act='<position name="wrist" joint="wrist" kp="%g"/>' % (1 if FIX else 20),
    )
)
data = mujoco.MjData(model)
resets, before = 0, 0.0
for _ in range(1000):
    data.ctrl[:] = 0.1
    mujoco.mj_step(model, data)
    resets, before = resets + (data.time < before), data.time
print("resets:", resets, "angle:", data.qpos)

"""A velocity servo on a light wrist makes the simulation blow up."""

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
        act='<velocity name="wrist" joint="wrist" kv="%g"/>' % (0.0005 if FIX else 0.05),
    )
)
data = mujoco.MjData(model)
resets, before = 0, 0.0
for _ in range(1000):
    data.ctrl[:] = 0.5
    mujoco.mj_step(model, data)
    resets, before = resets + (data.time < before), data.time
print("resets:", resets, "rate:", data.qvel)

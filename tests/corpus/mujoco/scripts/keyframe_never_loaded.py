"""My model has a home keyframe, and the arm stays stretched out."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><compiler angle="radian"/><worldbody><body name="arm" pos="0 0 1" gravcomp="1"><joint name="shoulder" axis="0 1 0" damping="1"/>
 <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/><body name="fore" pos=".3 0 0" gravcomp="1"><joint name="elbow" axis="0 1 0" damping="1"/>
 <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/></body></body></worldbody>
<actuator><position name="s" joint="shoulder" kp="300"/><position name="e" joint="elbow" kp="300"/></actuator>
<keyframe><key name="home" qpos="-0.8 1.2" ctrl="-0.8 1.2"/></keyframe></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
if FIX:
    mujoco.mj_resetDataKeyframe(model, data, 0)
for _ in range(1000):
    mujoco.mj_step(model, data)
print(data.qpos)

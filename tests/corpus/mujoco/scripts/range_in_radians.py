"""My joint is stuck at almost zero, the range is -1.57 to 1.57."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco>{c}<worldbody><body name="arm" pos="0 0 1" gravcomp="1"><joint name="shoulder" axis="0 1 0" damping="1" range="-1.57 1.57"/>
 <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="1"/></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="100" kv="5"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(c='<compiler angle="radian"/>' if FIX else ""))
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data)
print("angle", data.qpos[0])

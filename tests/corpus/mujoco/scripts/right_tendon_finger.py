"""Tendon driven finger: one motor pulls a fixed tendon over two joints with return springs."""
import mujoco
xml = '''<mujoco><compiler angle="radian"/><option timestep=".002"/><default><joint axis="0 1 0" damping=".005" stiffness=".05" range="0 1.6" limited="true" armature="1e-5"/><geom type="capsule" size=".008" density="1000"/></default>
<worldbody><body name="p1" pos="0 0 .2"><joint name="j1"/><geom fromto="0 0 0 .04 0 0"/><body name="p2" pos=".04 0 0"><joint name="j2"/><geom fromto="0 0 0 .03 0 0"/></body></body></worldbody>
<tendon><fixed name="flex"><joint joint="j1" coef=".01"/><joint joint="j2" coef=".008"/></fixed></tendon>
<actuator><motor name="pull" tendon="flex" ctrlrange="0 20" ctrllimited="true"/></actuator></mujoco>'''
m = mujoco.MjModel.from_xml_string(xml); d = mujoco.MjData(m)
for i in range(1500):
    d.ctrl[0] = min(5, i * .005)
    mujoco.mj_step(m, d)
print(d.qpos)

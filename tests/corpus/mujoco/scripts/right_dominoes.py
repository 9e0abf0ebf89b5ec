"""Ten dominoes, the first is pushed over."""
import mujoco
stones = "".join(f'<body name="d{i}" pos="{.05 * i} 0 .06"><freejoint/><geom type="box" size=".008 .03 .06" mass=".05" friction=".6"/></body>' for i in range(10))
xml = f'<mujoco><option timestep=".001"/><worldbody><geom type="plane" size="2 2 .1"/>{stones}</worldbody></mujoco>'
m = mujoco.MjModel.from_xml_string(xml); d = mujoco.MjData(m)
for i in range(2000):
    d.xfrc_applied[1, :3] = [.3, 0, 0] if i < 80 else 0
    d.xfrc_applied[1, 4] = .03 if i < 80 else 0
    mujoco.mj_step(m, d)
print(d.qpos[7 * 9:7 * 9 + 3])

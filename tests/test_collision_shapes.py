"""Validation: PyBullet touches concave meshes where they have no surface, and we report it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from asked import found, in_pieces
from clients import release_clients
from conftest import some
from drop_physics.recording import schema
from drop_physics.recording.reader import contents
from drop_physics.rules.collides_as_hull import distances_m
from drop_physics.stages.analyze import analyze
from scenes import HEAD, record
from viewer import COLOURED, Viewer, vulkan_driver

RING = """
import math
def ring(inner, outer, height, n):
    v, f = [], []
    for k in range(n):
        c, s = math.cos(2 * math.pi * k / n), math.sin(2 * math.pi * k / n)
        v += [(r * c, r * s, z) for r in (inner, outer) for z in (0, height)]
    for k in range(n):
        a, b = 4 * k + 1, 4 * ((k + 1) % n) + 1
        for i, j in ((0, 1), (1, 3), (3, 2), (2, 0)):
            f += [(a + i, a + j, b + j), (a + i, b + j, b + i)]
    return "".join("v %.9g %.9g %.9g\\n" % x for x in v) + "".join("f %d %d %d\\n" % x for x in f)
"""
PEG = (
    RING
    + """
p.setGravity(0, 0, -9.81)
with open(r"{folder}/ring.obj", "w") as o:
    o.write(ring(.05, .1, .04, {n}))
a = p.createMultiBody(0, p.createCollisionShape(
    p.GEOM_MESH, fileName=r"{folder}/ring.obj", meshScale=[{scale}] * 3{flags}))
b = p.createMultiBody(.2, p.createCollisionShape(p.GEOM_CYLINDER, radius=.02, height=.1),
    -1, [0, 0, .2 * {scale}])
steps(240)
"""
)
URDF = """<robot name="cup"><link name="base"><inertial><mass value="{mass}"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial><collision{concave}>
<origin xyz="0 0 -.02" rpy="0 0 .3"/><geometry><mesh filename="ring.obj"/></geometry></collision>
</link></robot>"""
THROWN = (
    RING
    + """
p.setGravity(0, 0, -9.81)
with open(r"{folder}/ring.obj", "w") as o:
    o.write(ring(.07, .1, .04, 16))
with open(r"{folder}/cup.urdf", "w") as o:
    o.write('''{urdf}''')
p.loadURDF("plane.urdf")
a = p.loadURDF(r"{folder}/cup.urdf", [0, 0, .3], useFixedBase={fixed})
b = p.createMultiBody(.05, p.createCollisionShape(p.GEOM_SPHERE, radius=.02), -1, [.01, 0, .5])
steps(360)
"""
)
CASES = {
    "peg": (PEG, {"n": 24, "scale": 1}, {"flags": ", flags=p.GEOM_FORCE_CONCAVE_TRIMESH"}),
    "twice as large": (
        PEG,
        {"n": 48, "scale": 2},
        {"flags": ", flags=p.GEOM_FORCE_CONCAVE_TRIMESH"},
    ),
    "a ball over a cup of a URDF": (
        THROWN,
        {"fixed": 1, "urdf": URDF.format(mass=1, concave="")},
        {"urdf": URDF.format(mass=1, concave=' concave="yes"')},
    ),
    "a ball on a cup that falls": (THROWN, {"fixed": 0, "urdf": URDF.format(mass=1, concave="")},
        None),
}  # fmt: skip


def bare(scene: str) -> float:
    """Run a scene; return the end height of its body b."""
    release_clients()
    names: dict[str, int] = {}
    exec(HEAD + scene, names)
    (_, _, height), _ = p.getBasePositionAndOrientation(names["b"])
    p.disconnect()
    return float(height)


@pytest.mark.parametrize("name", some(CASES, 1))
def test_a_hollow_is_closed_by_its_hull(name: str, tmp_path: Path) -> None:
    scene, given, cure = CASES[name]
    given = {"folder": tmp_path, "flags": "", **given}
    (one,) = found(scene.format(**given), tmp_path, "collides-as-hull")
    assert one.level == "asked"
    assert one.effect is not None
    assert one.effect.value > 0.01
    assert one.site is not None
    line = scene.format(**given).lstrip().splitlines()[int(one.site.split(":")[1]) - 1]
    assert line.startswith(("a = p.createMultiBody", "    p.GEOM_MESH", "a = p.loadURDF"))
    (other,) = in_pieces(scene.format(**given), tmp_path, "collides-as-hull")
    assert (other.message, other.steps) == (one.message, one.steps)
    if cure is not None:
        cured = scene.format(**(given | cure))
        assert bare(cured) < bare(scene.format(**given)) - 0.02
        assert not found(cured, tmp_path, "collides-as-hull")


CUBE = """
p.setGravity(0, 0, -9.81)
f = p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 2, .5])
p.createMultiBody(0, f, -1, [0, 0, -.5])
with open(r"{folder}/cube.obj", "w") as o:
    for k in range(8):
        o.write("v %g %g %g\\n" % tuple(.1 if k >> n & 1 else -.1 for n in (2, 1, 0)))
    for face in ((1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2), (3, 4, 8),
        (3, 8, 7), (1, 3, 7), (1, 7, 5), (2, 6, 8), (2, 8, 4)):
        o.write("f %d %d %d\\n" % face)
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_MESH, fileName=r"{folder}/cube.obj"), -1,
    [0, 0, {z}], p.getQuaternionFromEuler([.3, .2, 0]))
p.resetBaseVelocity(b, [{v}, 0, 0], [3, 5, 1])
steps(240)
"""
ROLLS = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
for k, file in enumerate(("duck.obj", "soccerball.obj", "lego/lego.obj", "teddy2_VHACD_CHs.obj")):
    s = p.createCollisionShape(p.GEOM_MESH, fileName=file, meshScale=[.1] * 3)
    b = p.createMultiBody(1, s, -1, [k, 0, .4])
steps(360)
"""
BESIDE = (
    RING
    + """
p.setGravity(0, 0, -9.81)
with open(r"{folder}/ring.obj", "w") as o:
    o.write(ring(.05, .1, .04, 24))
p.loadURDF("plane.urdf")
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_MESH, fileName=r"{folder}/ring.obj"),
    -1, [0, 0, .3], p.getQuaternionFromEuler([.4, 0, 0]))
steps(360)
"""
)
ARM = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
b = p.loadURDF("kuka_iiwa/model.urdf", [0, 0, 0], useFixedBase=True)
for j in range(7):
    p.setJointMotorControl2(b, j, p.POSITION_CONTROL, 2 if j == 1 else 0, force=300)
steps(240)
"""


@pytest.mark.parametrize(
    "scene",
    [
        CUBE.replace("{z}", "1").replace("{v}", "0"),
        CUBE.replace("{z}", "3").replace("{v}", "2"),
        ROLLS,
        BESIDE,
    ],
    ids=["a cube", "a fast cube", "nearly convex ones", "a ring on a floor"],
)
def test_what_is_touched_on_its_surface_is_its_hull(scene: str, tmp_path: Path) -> None:
    assert not found(scene.replace("{folder}", str(tmp_path)), tmp_path, "collides-as-hull")


def test_distances_to_triangles() -> None:
    corners_m = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]])
    triangles = np.array([[0, 1, 2], [0, 3, 1]])  # the other one has no area
    points_m = np.array([[0.2, 0.2, 0.5], [2, 0, 0], [1, 1, 0], [-3, 0, 4], [0.5, -1, 0]])
    far_m = [0.5, 1, math.sqrt(0.5), 5, 1]
    assert distances_m(points_m, corners_m, triangles) == pytest.approx(far_m)


def test_the_surfaces_are_those_of_the_files(tmp_path: Path) -> None:
    scene = PEG.format(n=24, scale=2, folder=tmp_path, flags="")
    seen = record(scene, tmp_path / "scene.rrd").seen
    (surface,) = seen.surfaces
    hull = np.reshape(seen.bodies[0].collisions[0].hull_m, (-1, 3))
    gaps = np.linalg.norm(hull[:, None] - surface.corners_m, axis=2).min(axis=1)
    assert gaps.max() < 1e-4  # Bullet moves corners of hulls onto a grid
    assert len(surface.triangles) == 24 * 8
    (a, b, c) = (surface.corners_m[surface.triangles[:, k]] for k in range(3))
    volume_m3 = abs(np.einsum("ti,ti->t", a, np.cross(b, c)).sum()) / 6
    polygon = 24 / 2 * math.sin(2 * math.pi / 24)
    assert volume_m3 == pytest.approx(polygon * (0.2**2 - 0.1**2) * 0.08, rel=1e-4)


def test_a_surface_that_recurs_is_kept_once(tmp_path: Path) -> None:
    scene = PEG.format(n=24, scale=1, folder=tmp_path, flags="")
    scene += f"""
for x, scale in ((1, 1), (2, 2), (3, 1)):
    p.createMultiBody(1, p.createCollisionShape(
        p.GEOM_MESH, fileName=r"{tmp_path}/ring.obj", meshScale=[scale] * 3), -1, [x, 0, 1])
    steps(2)
"""
    path = tmp_path / "scene.rrd"
    recorded = record(scene, path)
    rows = [values for _, values in contents(path).told[schema.SURFACES]]
    assert [(row["body"], "triangles" in row) for row in rows] == [
        (0, True),
        (2, False),
        (3, True),
        (4, False),
    ]
    first, *same, larger = sorted(
        recorded.seen.surfaces, key=lambda surface: (surface.body == 3, surface.body)
    )
    for other, scale in [(each, 1) for each in same] + [(larger, 2)]:
        assert np.allclose(other.corners_m, scale * first.corners_m, atol=2e-6)
        assert np.array_equal(other.triangles, first.triangles)
    assert [each.at.step for each in (first, *same, larger)] == [0, 240, 244, 242]


def test_what_is_touched_is_drawn_but_hidden(tmp_path: Path) -> None:
    path = tmp_path / "scene.rrd"
    recording = record(PEG.format(n=24, scale=1, folder=tmp_path, flags=""), path)
    assert f"{schema.COLLISIONS}/0_mesh/base/0" in recording.entities
    # What is drawn as it is touched needs no second drawing.
    assert not any(
        "1_cylinder" in entity
        for entity in recording.entities
        if entity.startswith(schema.COLLISIONS)
    )


@pytest.mark.long
def test_the_hull_is_seen_where_a_finding_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if vulkan_driver() is None:
        pytest.skip("no software Vulkan; try: apt-get install mesa-vulkan-drivers")
    path = tmp_path / "scene.rrd"
    record(PEG.format(n=24, scale=1, folder=tmp_path, flags=""), path, for_viewer=True)
    orange = []
    for found_some in (True, False):
        if not found_some:
            monkeypatch.setattr("drop_physics.stages.analyze._hulls", lambda _: frozenset())
        layer = analyze(path).layer
        assert layer is not None
        with Viewer(path, layer) as viewer:
            viewer.set_time(0.5)
            viewer.view("World")
            viewer.settled()
            red, green, blue = np.moveaxis(viewer.view("World"), 2, 0)
            orange.append(int(((red > green + 30) & (green > blue + 10)).sum()))
            assert not viewer.warnings()
    assert orange[1] < COLOURED < orange[0], orange

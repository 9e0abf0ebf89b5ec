"""Hostile body files: whatever a URDF or a mesh does to Bullet, `drop` reports it in one line.

First the checks of the files alone, then the trials in a separate process.
"""

from __future__ import annotations

import json
import math
import os
import random
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
from conftest import Drop, some
from drop_physics import Scenario, simulate
from drop_physics.engines.pybullet import probe
from drop_physics.engines.pybullet.body_files import (
    MOST_JOINTS,
    MOST_POSITIONS,
    BodyFileError,
    check_mesh,
    check_urdf,
)
from drop_physics.engines.pybullet.found import find_body
from drop_physics.engines.pybullet.probe import Limits, problem_of
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import ScenarioError
from drop_physics.stages.sweep import sweep
from drop_physics.sweeping.plan import plan_of
from drop_physics.trace.states import BODY
from dropped import dropped_whole

DATA = Path(pybullet_data.getDataPath())
BOX = '<box size="0.1 0.1 0.1"/>'
TETRAHEDRON = """v 0 0 0
v 0.1 0 0
v 0 0.1 0
v 0 0 0.1
f 1 2 3
f 1//1 2//1 4//1
f 1/1/1 3/1/1 4/1/1
f -3 -2 -1
"""
LINK = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry>{shape}</geometry></collision>
<visual><geometry>{shape}</geometry></visual>
</link>
"""
JOINT = """<joint name="to-{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0.2 0 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint>
"""


def body(shape: str = BOX, more: str = "", first: str = "base") -> str:
    return f'<robot name="own">\n{LINK.format(name=first, shape=shape)}{more}</robot>\n'


def mesh(name: str, more: str = "") -> str:
    return body(f'<mesh filename="{name}" {more}/>')


def linked(count: int, kind: str = "fixed", *, star: bool = False) -> str:
    """Return a body with a number of joints, in a chain or all on its base."""
    more = "".join(
        LINK.format(name=f"l{number}", shape=BOX)
        + JOINT.format(kind=kind, parent=f"l{0 if star else number - 1}", child=f"l{number}")
        for number in range(1, count + 1)
    )
    return body(more=more, first="l0")


def written(folder: Path, text: str | bytes, name: str = "own.urdf") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def one_line(error: BaseException) -> None:
    assert len(str(error).splitlines()) == 1
    assert len(str(error)) < 600


def refused(path: Path, rule: str, check: Callable[[Path], None] = check_urdf) -> None:
    """Check that a URDF or a mesh is rejected for its content, in one line."""
    with pytest.raises(BodyFileError, match=rule) as raised:
        check(path)
    one_line(raised.value)


# -- text -----------------------------------------------------------------------------------------

IN_A_LINK = (
    *(
        f'<contact><{name} value="{{}}"/></contact>'
        for name in (
            "inertia_scaling",
            "lateral_friction",
            "rolling_friction",
            "spinning_friction",
            "restitution",
            "stiffness",
            "damping",
        )
    ),
    '<collision group="{}"><geometry><box size="1 1 1"/></geometry></collision>',
    '<collision mask="{}"><geometry><box size="1 1 1"/></geometry></collision>',
    '<collision><geometry><plane normal="0 0 {}"/></geometry></collision>',
    '<collision><geometry><mesh filename="m.obj" scale="1 {} 1"/></geometry></collision>',
    '<collision><geometry><mesh filename="m.obj" scale="{}"/></geometry></collision>',
    '<visual><geometry><box size="1 1 1"/></geometry><material name="m"><color rgba="1 1 {}"/>'
    "</material></visual>",
    '<visual><geometry><box size="1 1 1"/></geometry><material name="m"><specular rgb="1 1 {}"/>'
    "</material></visual>",
)
IN_A_JOINT = (
    '<axis xyz="0 {} 1"/>',
    *(f'<dynamics {name}="{{}}"/>' for name in ("damping", "friction")),
    *(f'<limit {name}="{{}}"/>' for name in ("lower", "upper", "twist", "effort", "velocity")),
)


@pytest.mark.parametrize("element", IN_A_LINK + IN_A_JOINT)
def test_every_number_that_bullet_reads_must_be_a_number(tmp_path: Path, element: str) -> None:
    written(tmp_path, TETRAHEDRON, "m.obj")
    spot = "</link>" if element in IN_A_LINK else "</joint>"

    def with_number(number: str) -> Path:
        return written(tmp_path, linked(1).replace(spot, element.format(number) + spot, 1))

    check_urdf(with_number("0.5"))
    for bad in ("nan", "inf", "-inf", "", "word", "1_0", "1e999", "0x10", "１"):
        refused(with_number(bad), "must be")


SPELLED: dict[str, str | bytes] = {
    "a scale in tabs": mesh("m.obj", 'scale="1\t2\t3"'),
    "a namespace": body(BOX.replace("<box", '<box xmlns="x"').replace("0.1 0", "nan 0")),
    "a tab as an entity": body(BOX.replace(" 0.1", "&#9;0.1")),
    "single quotes": body("<box size='nan 1 1'/>"),
    "another attribute first": body("<box a=' size=\"1 1 1\"' size=\"nan 1 1\"/>"),
    "a long line": body(more=" " * 8_192),
    "a carriage return": body().replace("<collision>", "<!-- \r --><collision>"),
    "UTF-16": body().encode("utf-16"),
    "a document type": "<!DOCTYPE r>" + body(),
    "a negative radius": body('<sphere radius="-1"/>'), "a long name": body(first="l" * 1001),
}  # fmt: skip


@pytest.mark.parametrize("kind", SPELLED)
def test_what_bullet_would_misread_is_rejected(tmp_path: Path, kind: str) -> None:
    refused(written(tmp_path, SPELLED[kind]), ".")


def test_a_large_file_or_none_at_all_is_refused(tmp_path: Path) -> None:
    for name, most, check in (("own.urdf", 10_000_000, check_urdf), ("m.obj", 10**8, check_mesh)):
        path = tmp_path / name
        with path.open("wb") as sparse:
            sparse.truncate(most + 1)
        refused(path, f"more than {most:,} bytes", check)
        path.unlink()
        refused(path, "cannot be read", check)
        path.symlink_to("/dev/zero")
        refused(path, "not a regular file", check)


# -- links ----------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_limits_of_joints_are_those_of_pybullet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the limits PyBullet reads correctly; beyond them, nothing or a wrong velocity."""
    monkeypatch.setattr(probe, "problem_of", lambda _: ("", []))
    for kind, most in (
        ("fixed", MOST_JOINTS),
        ("revolute", MOST_POSITIONS),
        ("spherical", MOST_POSITIONS // 4),
        ("planar", MOST_POSITIONS // 3),
    ):
        for star in (True, False):
            path = written(tmp_path, linked(most, kind, star=star))
            check_urdf(path)
            refused(written(tmp_path, linked(most + 1, kind, star=star), "more.urdf"), "joints")
        scenario = Scenario(body=str(path), duration_s=0.1, linear_damping=0.0)
        with World(scenario) as world:
            base = dropped_whole(world).bases[BODY]
        np.testing.assert_allclose(base[-1, 9], scenario.gravity_m_s2 * 0.1, rtol=1e-9)


# -- meshes ---------------------------------------------------------------------------------------


def stl(triangles: int, *, count: int | None = None, first: float = 0.0) -> bytes:
    corners = struct.pack("<12f2x", 0, 0, 1, first, 0, 0, 0.1, 0, 0, 0, 0.1, 0.1)
    return (
        bytes(80) + struct.pack("<I", triangles if count is None else count) + corners * triangles
    )


MESHES: dict[str, tuple[str | bytes, str]] = {
    **{
        f"face {face}": (f"{TETRAHEDRON}f {face}\n", "obj")
        for face in (
            "99999999 1 2", "5 1 2", "1 2 -5", "-99999999 1 2", "0 1 2", "1 2 x", "1.5 2 3",
            "1/0/1 2 3", "1//0 2 3", "1//2147483648 2 3", "1/2/3/4 2 3", "4294967297 2 3",
            "9" * 30 + " 1 2", "1// 2 3", "/1/1 2 3", "1_0 2 3", "nan 1 2",
        )
    },
    **{
        f"vertex {vertex}": (f"v {vertex}\n{TETRAHEDRON}", "obj")
        for vertex in (
            "nan 0 0", "0 inf 0", "0 0 1e999", "0 0", "", "a b c", "1e308 1e308 1e308", "0 1_0 0",
            "0 ١ 0",
        )
    },
    "before its vertices": ("f -1 -2 -3\n" + TETRAHEDRON, "obj"),
    "a long line": (TETRAHEDRON + "f" + " 1 2 3" * 200 + "\n", "obj"),
    "carriage returns": (TETRAHEDRON.replace("\n", "\r"), "obj"),
    "a zero": (TETRAHEDRON + "#\0\n", "obj"),
    "a text": ("solid a\nendsolid a\n", "stl"),
    "a text of 84 bytes": ("solid a" + " " * 77, "stl"),
    "nothing": (b"", "stl"), "half a head": (bytes(40), "stl"),
    "cut": (stl(4)[:-1], "stl"), "too long": (stl(4) + b"x", "stl"),
    "too many": (stl(4, count=5), "stl"), "minus one": (stl(4, count=2**32 - 1), "stl"),
    # 50 times this is 0 in 32 bits, so that Bullet accepts the size.
    "a wrapped count": (stl(4, count=2**31 + 4), "stl"),
    "nan": (stl(4, first=math.nan), "stl"), "inf": (stl(4, first=math.inf), "stl"),
}  # fmt: skip


@pytest.mark.parametrize("kind", MESHES)
def test_a_mesh_that_bullet_would_misread_is_refused(tmp_path: Path, kind: str) -> None:
    content, suffix = MESHES[kind]
    refused(written(tmp_path, content, f"m.{suffix}"), "m.(obj|stl)", check_mesh)


@pytest.mark.parametrize(
    ("line", "quoted"),
    [
        ("v 1 2 x", "'v 1 2 x' must hold three finite numbers"),
        ("v 0 0 é'", '"v 0 0 é\'" must hold three finite numbers'),
        ("f 1 2 x", "'x' is not a corner of a face"),
        ("f 1 2 -9", "'-9' is a vertex before the first"),
    ],
)
def test_a_mesh_is_quoted_as_it_is_written(tmp_path: Path, line: str, quoted: str) -> None:
    """It is not quoted as Python's repr of bytes."""
    with pytest.raises(BodyFileError) as raised:
        check_mesh(written(tmp_path, f"{TETRAHEDRON}{line}\n", "m.obj"))
    assert quoted in str(raised.value)
    assert "b'" not in str(raised.value)


def test_good_meshes_are_accepted(tmp_path: Path) -> None:
    check_mesh(written(tmp_path, TETRAHEDRON.replace("\n", "\r\n"), "m.obj"))
    check_mesh(written(tmp_path, stl(4), "M.STL"))


def test_nearly_every_body_of_pybullet_data_passes_the_checks_for_own_files() -> None:
    """The rejected ones are not XML, lack numbers, or have a radius of 0 or a NUL character."""
    bodies = sorted(DATA.glob("*.urdf")) + sorted(DATA.glob("[!r]*/*.urdf"))
    failed = set()
    for path in bodies:
        try:
            check_urdf(path)
        except BodyFileError:
            failed.add(path.name)
    assert len(bodies) > 80
    assert failed == {
        "bike.urdf",
        "biped2d_pybullet.urdf",
        "diff_ring.urdf",
        "husky.urdf",
        "laikago_toes.urdf",
        "laikago_toes_limits.urdf",
        "laikago_toes_zup.urdf",
        "laikago_toes_zup_lores.urdf",
        "humanoid.urdf",
    }


# -- what is tried --------------------------------------------------------------------------------

CONE = (DATA / "racecar/meshes/cone.dae").read_text()
DEADLY: dict[str, tuple[str, dict[str, str], str]] = {
    "an index of a .dae": (
        mesh("m.dae"),
        {"m.dae": re.sub(r"(<p>\s*)\d+", r"\g<1>99999999", CONE)},
        "crashes",
    ),
    "two roots": (body(more=LINK.format(name="other", shape=BOX)), {}, "crashes"),
    "a size beyond numbers": (mesh("m.obj"), {"m.obj": TETRAHEDRON.replace("0.1", "1e30")}, "size"),
    "a bad face of a mesh": (mesh("m.obj"), {"m.obj": TETRAHEDRON + "f 1 2 99999999\n"}, "vertex"),
    "no mesh": (mesh("gone.obj"), {}, "cannot find 'gone.obj'"),
    "tabs between": (body(BOX.replace(" 0.1", "\t0.1")), {}, "parse vector3"),
}


@pytest.mark.parametrize("kind", some(DEADLY, 1))
def test_what_ends_bullet_is_one_line_here(tmp_path: Path, kind: str) -> None:
    urdf, files, why = DEADLY[kind]
    for name, content in files.items():
        written(tmp_path, content, name)
    with pytest.raises(ScenarioError, match="body must be a URDF that Bullet can load") as raised:
        find_body(str(written(tmp_path, urdf)))
    one_line(raised.value)
    assert why in str(raised.value)


def test_the_command_ends_with_one_line_where_bullet_would_end_it(
    drop: Drop, tmp_path: Path
) -> None:
    written(tmp_path, CONE.replace("<input ", "<was-input "), "m.dae")
    written(tmp_path, mesh("m.dae"))
    done = drop("run", "--body", "own.urdf", "--json")
    assert done.returncode == 2, done.stderr
    assert json.loads(done.stdout)["error"].startswith("--body")
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("drop: --body")
    assert {file.name for file in tmp_path.iterdir()} <= {"own.urdf", "m.dae", "recordings"}


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_trial_that_waits_forever_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It waits for a texture in an unlikely folder that Bullet searches."""
    (tmp_path / "data" / "data").mkdir(parents=True)
    os.mkfifo(tmp_path / "data" / "data" / "pipe.png")
    written(tmp_path, "newmtl a\nmap_Kd pipe.png\n", "a.mtl")
    written(tmp_path, "mtllib a.mtl\nusemtl a\n" + TETRAHEDRON, "m.obj")
    monkeypatch.chdir(tmp_path)
    words = "not finished with it after 2 s, and computed for less than 20 s: it waits"
    assert words in problem_of(written(tmp_path, mesh("m.obj")), Limits(wall_s=2))[0]


@pytest.mark.long
def test_a_trial_that_computes_forever_is_ended(tmp_path: Path) -> None:
    shape = "<collision><geometry><box size='1 1 1'/></geometry></collision>\n"
    many = body().replace("<visual>", shape * 20_000 + "<visual>")
    words = "not finished with it after 1 s of computing"
    assert words in problem_of(written(tmp_path, many), Limits(cpu_s=1))[0]


@pytest.mark.long
def test_a_trial_that_takes_too_much_memory_is_ended(tmp_path: Path) -> None:
    limits = Limits(memory_bytes=600_000_000)
    assert problem_of(written(tmp_path, body()), limits) == ("", [])
    written(tmp_path, re.sub(r'count="\d+"', 'count="300000000"', CONE, count=1), "m.dae")
    assert "more than 0.6 GB" in problem_of(written(tmp_path, mesh("m.dae")), limits)[0]


# -- how often ------------------------------------------------------------------------------------


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Collect the bodies that this process loads on trial from now on."""
    tried: list[Path] = []

    def passed(path: Path) -> tuple[str, list[Path]]:
        tried.append(path)
        return "", [path.with_name("m.obj")]

    monkeypatch.setattr(probe, "_verdicts", {})
    monkeypatch.setattr(probe, "problem_of", passed)
    return tried


def test_a_body_of_pybullet_is_never_tried(tmp_path: Path, trials: list[Path]) -> None:
    simulate(Scenario(duration_s=0.1), tmp_path / "run.rrd")
    find_body("duck_vhacd.urdf")
    assert trials == []


def test_a_body_is_tried_once_and_again_when_any_of_its_files_changes(
    tmp_path: Path, trials: list[Path]
) -> None:
    written(tmp_path, TETRAHEDRON, "m.obj")
    path = written(tmp_path, mesh("m.obj"))
    find_body(str(path))
    with World(Scenario(body=str(path))):
        assert len(trials) == 1
    for count, name in enumerate(("own.urdf", "m.obj"), start=2):
        with (tmp_path / name).open("ab") as file:
            file.write(b"\n")
        find_body(str(path))
        find_body(str(path))
        assert len(trials) == count, name


def test_what_is_believed_is_a_digest_and_not_a_name(tmp_path: Path, trials: list[Path]) -> None:
    path = written(tmp_path, body())
    find_body(str(path))
    known = probe.verdicts()
    probe._verdicts.clear()
    probe.believe(known)
    find_body(str(path))
    assert len(trials) == 1
    written(tmp_path, body(more="<!-- another -->"))
    find_body(str(path))
    assert len(trials) == 2


@pytest.mark.long
def test_a_sweep_tries_each_body_once_and_a_deadly_one_is_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good, bad = written(tmp_path, body()), written(tmp_path, body("<plane normal='0 0 0'/>"), "b")
    begun: list[Path] = []

    def counted(path: Path) -> tuple[str, list[Path]]:
        begun.append(path)
        return problem_of(path)

    monkeypatch.setattr(probe, "problem_of", counted)
    bodies = f"{good},{bad}"
    plan = plan_of({"body": bodies, "timestep_s": "1/240,1/480", "duration_s": "0.1"})
    done = sweep(plan, tmp_path / "sweep", at_s=0.05, record=False, jobs=2)
    assert sorted(begun) == sorted([good, bad])
    assert (done.runs, done.failed) == (4, 2)
    failures = {row["error"] for row in done.rows if row["error"]}
    assert all("its size must be finite" in failure for failure in failures)
    assert failures


# -- mutations ------------------------------------------------------------------------------------

WORDS = (
    b"nan", b"inf", b"1e308", b"-1", b"0", b"", b"99999999", b"-99999999", b"4294967297", b'"',
    b"<", b"/>", b"\0", b"\n", b"\r", b"\t", b"x" * 3000, b"/dev/zero", b"&amp;", b"f 1 2 3\n",
    b"f 0 0 0\n", b"f -1 -2 -9999\n", b"v nan nan nan\n", b"g a\n", b'<link name="more"/>',
)  # fmt: skip
MUTATED = {
    "duck_vhacd.urdf": ("duck.obj", "duck_vhacd.obj"),
    "jenga/jenga.urdf": ("jenga.mtl", "jenga.obj"),
    "racecar/meshes": ("cone.dae",),
    "husky/meshes": ("wheel.stl",),
}


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Delete a part of a file, repeat it, or replace it with something hard to parse."""
    start = chance.randrange(len(data) + 1)
    stop = min(len(data), start + chance.choice([0, 1, 4, 40]))
    middle = chance.choice([chance.choice(WORDS), data[start:stop] * 50, chance.randbytes(1)])
    return data[:start] + middle + data[stop:]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(12))
def test_mutations_of_pybullets_own_files_are_loaded_or_refused(tmp_path: Path, seed: int) -> None:
    """If this process dies, a bad body has passed the checks."""
    chance = random.Random(seed)
    place, names = chance.choice(sorted(MUTATED.items()))
    home = DATA / place if (DATA / place).is_dir() else (DATA / place).parent
    for name in names:
        shutil.copy(home / name, tmp_path)
    urdf = written(tmp_path, mesh(chance.choice([name for name in names if name[-3:] != "mtl"])))
    victim = chance.choice([urdf, *(tmp_path / name for name in names)])
    victim.write_bytes(mutated(victim.read_bytes(), chance))
    try:
        find_body(str(urdf))
    except ScenarioError as error:
        one_line(error)
        return
    with World(Scenario(body=str(urdf), height_m=0.1, duration_s=0.1)) as world:
        assert len(dropped_whole(world).steps) == 25

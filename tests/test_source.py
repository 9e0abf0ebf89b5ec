"""Single changes of a script's source: its numbers and statements.

Verification: an edit makes of the text what its user would write, and what only says what is
measured is none.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from drop_physics.engines.source import (
    changes_of,
    converts_unit,
    edits_of,
    place_of,
    repeats,
    words_of,
)
from drop_physics.engines.watching.edits import InTwoParts, edited
from drop_physics.engines.watching.single_changes import Change
from drop_physics.stages.rerun.single import is_single, named, text_of
from drop_physics.stages.rerun.source_texts import source_texts

TEXT = '''"""A script."""
from __future__ import annotations
import sys
import numpy as np
FIX = len(sys.argv) > 1
GOAL = 0.4
KP = 20 if FIX else -5
XML = """<mujoco><option timestep="0.002"/><worldbody>
<body name="arm" pos="0 0 .5"><joint name="hinge" range="-1 1" damping="2"/>
<geom size=".1 0.2" rgba="1 0 0 1"/></body></worldbody></mujoco>"""
def held(torque, gain=3.0):
    data.ctrl[0] = -torque
    return gain
worst = 0
for step in range(300):
    data.qpos[:] = [0.1, step]
    error = GOAL - data.qpos[0]
    p.setJointMotorControl2(arm, 1, p.TORQUE_CONTROL, force=KP * error + 7)
    if step > 150:
        worst = max(worst, abs(error))
assert worst < 0.3
print("worst", 1000 * worst)
'''


def found(expected: str = "worst < 0.3") -> list[Change]:
    """Return the changes of the source text."""
    return changes_of(TEXT.encode(), "script.py", expected)


def made(change: Change) -> str:
    """Return the source text with a change applied."""
    return edited(TEXT.encode(), edits_of(change)).decode()


def test_what_a_user_would_edit_is_found_and_what_is_only_measured_is_not() -> None:
    numbers = {(each.change, each.of[0]) for each in found() if each.op == "*-1"}
    assert numbers == {
        ("KP", "20"),
        ("KP", "-5"),
        ("held.gain", "3.0"),
        ("data.qpos[:]", "0.1"),
        ("setJointMotorControl2.force", "7"),
        ("number", "150"),
        ("joint.range", "hinge#1"),
    }, "no argument, index, bound or goal; what the compiled model has is changed there"
    left_out = {each.change for each in found() if each.op == "left-out"}
    assert left_out == {"data.ctrl[0]", "data.qpos[:]", "joint.range", "option.timestep"}
    assert {each.of for each in found() if each.change == "index"} == {("data.ctrl[0]",)}


def test_what_is_expected_is_no_change_where_it_is_a_number_and_is_one_elsewhere() -> None:
    assert not [each for each in found("abs(error) < 0.1") if each.change == "GOAL"]
    assert [each for each in found("z('arm') < 0.1") if each.change == "GOAL"]


@pytest.mark.parametrize(
    ("name", "op", "line"),
    [
        ("KP", "*10", "KP = 20 if FIX else (-50)"),
        ("KP", "*-1", "KP = 20 if FIX else 5"),
        ("held.gain", "*0.1", "def held(torque, gain=0.3):"),
        ("geom.size", "*2", '<geom size="0.2 0.4" rgba="1 0 0 1"/></body></worldbody></mujoco>"""'),
        (
            "joint.range",
            "left-out",
            '<body name="arm" pos="0 0 .5"><joint name="hinge"  damping="2"/>',
        ),
        ("data.ctrl[0]", "left-out", "    pass"),
        ("index", "+1", "    data.ctrl[1] = -torque"),
        (
            "joint.range",
            "*57.2957795",
            '<body name="arm" pos="0 0 .5"><joint name="hinge" range="-57.2957795 57.2957795" '
            'damping="2"/>',
        ),
        ("option.timestep", "*0.1", 'XML = """<mujoco><option timestep="0.0002"/><worldbody>'),
    ],
)
def test_an_edit_is_what_its_user_would_write(name: str, op: str, line: str) -> None:
    change = [each for each in found() if (each.change, each.op) == (name, op)][-1]
    before, after = TEXT.splitlines(), made(change).splitlines()
    assert len(before) == len(after), "lines keep their numbers"
    (differing,) = (
        n for n, (one, other) in enumerate(zip(before, after, strict=True)) if one != other
    )
    assert after[differing] == line
    assert place_of(change)[0] == f"script.py:{differing + 1}"
    assert f"script.py:{differing + 1}" in words_of(change)


def test_how_often_an_inner_loop_is_repeated_is_a_whole_number_and_of_an_outer_one_no_change() -> (
    None
):
    text = b"""
N = 4
def control():
    for _ in range(30):
        step()
for k in range(100):
    control()
    for _ in range(N):
        step()
"""
    counts = [each for each in changes_of(text, "s.py", "") if each.op != "left-out"]
    assert [(each.change, each.op, each.of) for each in counts] == [
        ("N", "*10", ("4",)),
        ("range", "*10", ("30",)),
        ("range", "*0.1", ("30",)),
    ]
    more, _, fewer = counts
    assert b"N = 10\n" in edited(text, edits_of(more.by(2.6)))
    assert b"range(1)" in edited(text, edits_of(fewer.by(0.01))), "none would be another script"
    assert words_of(fewer) == "3 in place of 30 (s.py:4)"
    assert [*map(repeats, counts)] == [10, 10, 1]


def test_where_things_begin_is_a_part_of_the_scene_and_what_a_loop_sets_is_none() -> None:
    assert not any(each.breaks for each in found())
    before_it = TEXT.replace("for step in range(300):", "if True:")
    (first, *_) = (e for e in changes_of(before_it.encode(), "s", "") if e.change == "data.qpos[:]")
    assert first.breaks


def test_an_attribute_that_many_elements_have_is_one_change_of_all() -> None:
    geoms = "".join(f'<geom name="g{n}" size="0.{n}"/>' for n in range(1, 9))
    sizes = [e for e in changes_of(f"XML = '''{geoms}'''".encode(), "s.py", "") if e.op == "*2"]
    assert [each.of for each in sizes] == [tuple(f"g{n}" for n in range(1, 9))]
    half = sizes[0].of_some([1])
    assert (half.of, half.change) == (("g2",), "geom.size")
    assert edited(f"XML = '''{geoms}'''".encode(), edits_of(half)).count(b'"0.4"') == 2


def test_an_angle_in_the_wrong_unit_is_converted_by_one_change() -> None:
    text = (
        """URDF = '<joint name="j"><origin xyz="0 0 1" rpy="0 90 0"/><limit lower="-2"/></joint>'"""
    )
    found = [e for e in changes_of(text.encode(), "s.py", "") if converts_unit(e)]
    assert [e.change for e in found] == ["origin.rpy", "limit.lower"]
    assert b'rpy="0 1.570796325 0"' in edited(text.encode(), edits_of(found[0]))
    assert b'lower="-114.591559"' in edited(text.encode(), edits_of(found[1]))


def test_a_script_in_two_parts_is_the_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Imports run first, then the rest, possibly edited: names and line numbers are unchanged."""
    tmp_path.joinpath("mine.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    lines = [
        '"""About."""',
        "from __future__ import annotations",
        "import os, sys",
        'os.environ.setdefault("DROP_TEST", "1")',
        "import json",
        "import mine",
        "N = 5",
        "def f(x: Missing): return x",
        "raise ValueError(f(N))",
    ]
    text = "\n".join(lines).encode()
    parts = InTwoParts(text, "script.py", str(tmp_path))
    assert "json" in parts.first.co_names
    assert "mine" not in parts.first.co_names, "its text may be another"
    (ten,) = (e for e in changes_of(text, "s", "") if (e.change, e.op) == ("N", "*10"))
    names: dict[str, Any] = {}
    exec(parts.first, names)
    assert "N" not in names
    with pytest.raises(ValueError, match=r"^50$") as raised:
        exec(parts.second(edits_of(ten)), names)
    assert raised.traceback[-1].lineno + 1 == len(lines)
    assert names["__doc__"] == "About."
    assert names["f"].__annotations__ == {"x": "Missing"}


@pytest.mark.parametrize(
    ("op", "how"),
    [
        *(("^", ("^", None)), ("^8", ("^", 8.0)), ("=0", ("=", 0.0)), ("*-1", ("*", -1.0))),
        *(("/2", ("/", 2.0)), ("+10M0", ("+", None)), ("stiff", ("s", None))),
        *(("left-out", ("l", None)), ("=default", ("=", 1.0)), ("late", ("l", None))),
    ],
)
def test_what_is_printed_of_a_change_names_it(op: str, how: tuple[str, Any]) -> None:
    change = Change("jnt_range", op, how, (3, 4), ("left hip", "knee"), site=("a.py", 7))
    other = replace(change, op="*10", how=("*", 10.0))
    for each in (change, change.of_some([1]), replace(change, site=None), replace(change, of=())):
        text = text_of(each)
        assert is_single(text)
        assert named(text, [other, each]) == each
    assert named(text_of(other).replace("*10", "*2.5"), [other]) == other.by(2.5)
    assert not any(map(is_single, ("friction=2", "timestep/4", "residual 0", "damping")))


MODEL = """<robot name="arm"><link name="hand"><!-- <link name="old" size="3"/> -->
<collision><origin xyz="0 0 .1"/><geometry><box size="1 2 3"/></geometry></collision>
</link></robot>"""


def test_the_models_that_texts_name_are_texts_of_a_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module elsewhere is not the user's, and a comment in a model is no part of it."""
    script = tmp_path / "run" / "script.py"
    files = {
        "run/script.py": 'import mine; load("hand.urdf"); load("plane.urdf")',
        "run/mine.py": "path = os.path.join(HERE, 'models/arm.xml')",
        "run/models/arm.xml": '<mujoco><include file="../parts/leg.xml"/></mujoco>',
        "run/parts/leg.xml": "<mujoco/>",
        "here/hand.urdf": MODEL,
        "run/other.urdf": MODEL,
        "lib/elsewhere.py": "N = 4",
    }
    for name, text in files.items():
        tmp_path.joinpath(name).parent.mkdir(exist_ok=True, parents=True)
        tmp_path.joinpath(name).write_text(text)
    monkeypatch.chdir(tmp_path / "here")
    modules = [tmp_path / "run/mine.py", script, tmp_path / "lib/elsewhere.py"]
    texts = source_texts(script, modules)
    known = {"script.py", "mine.py", "models/arm.xml", "parts/leg.xml", "hand.urdf"}
    assert {each.shown for each in texts} == known
    assert [each.shown for each in texts if not each.path] == ["script.py"]
    hand = next(each for each in texts if each.shown == "hand.urdf")
    found = changes_of(hand.text, hand.shown, "", hand.path)
    assert {(each.change, each.op) for each in found} == {
        *(("origin.xyz", op) for op in ("*2", "*0.5", "*-1", "left-out")),
        *(("box.size", op) for op in ("*2", "*0.5")),
    }
    assert {name.partition("#")[0] for each in found for name in each.of} == {"hand"}
    larger = next(each for each in found if (each.change, each.op) == ("box.size", "*2"))
    assert edited(hand.text, edits_of(larger), hand.path).decode() == MODEL.replace(
        "1 2 3", "2 4 6"
    )
    assert edited(hand.text, edits_of(larger)) == hand.text, "that is another file"
    assert place_of(larger) == ("hand.urdf:2", "box.size=1 2 3")


def test_no_python_has_no_changes() -> None:
    assert changes_of(b"def (:", "s.py", "") == []
    assert changes_of("x = 5  # é".encode("latin-1"), "s.py", "") == []
    assert changes_of(b"x = 0x1f\ny = True\nz = 'a < b'\nw = 0.0\n", "s.py", "") == []

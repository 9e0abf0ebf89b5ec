"""Why two runs differ: the cause planted in a script is found, and proved by a swap.

Each second script is the first with one thing changed, beside which something may differ that has
no effect. The judge is how the scripts were made.
"""

from __future__ import annotations

import json
import lzma
import os
import subprocess
import sys
from ctypes.util import find_library
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import pytest
from conftest import Drop, some
from drop_physics import check, record
from drop_physics.engines.mujoco.elements import Elements, Matched
from drop_physics.engines.mujoco.fields_apart import FieldsApart
from drop_physics.engines.mujoco.memory import constants_of
from drop_physics.errors import DropError, ScenarioError
from drop_physics.experiments.swap.minimal import minimal
from drop_physics.report.diff import facts_of, json_of, report_of, values
from drop_physics.stages.diff import Diff, diff, wheels
from drop_physics.stages.diff.sides import sides_of

RECORDINGS = Path(__file__).parent / "recordings"
SCRIPT = '''
import mujoco, numpy as np
XML = """<mujoco><option timestep="0.002"/><worldbody>
 <geom name="floor" type="plane" size="2 2 .1"/>
 <body name="base" pos="0 0 .5"><body name="upper">
  <joint name="shoulder" axis="0 1 0" damping="0.2"/>
  <geom name="gu" type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1.0"/>
  <body name="fore" pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping="0.1"/>
   <geom name="gf" type="capsule" fromto="0 0 0 .3 0 0" size=".025" mass="0.6"/></body>
  </body></body>
 <body name="cube" pos=".45 0 .06"><freejoint/>
  <geom name="gc" type="box" size=".05 .05 .05" mass="0.4"/></body>
</worldbody><actuator><motor name="ms" joint="shoulder"/><motor name="me" joint="elbow"/></actuator>
</mujoco>"""
m = mujoco.MjModel.from_xml_string(XML)
d = mujoco.MjData(m)
for k in range(120):
    d.ctrl[:] = 0.3 * np.sin(0.1 * k), 0.1
    mujoco.mj_step(m, d)
'''
HEAVIER = SCRIPT.replace('mass="0.6"', 'mass="0.61"')
MARKED = SCRIPT.replace("</worldbody>", '<camera name="eye" pos="0 -2 1"/></worldbody>')
PUSHED = SCRIPT.replace("    mujoco.mj_step", "    if k == 40: d.ctrl[1] = 0.2\n    mujoco.mj_step")
LINE = PUSHED[: PUSHED.index("if k == 40")].count("\n") + 1
"""The line of the step in `PUSHED`, at which the write is detected."""


def compared(folder: Path, a: str, b: str, **how: Any) -> Diff:
    for name, text in (("a.py", a), ("b.py", b)):
        (folder / name).write_text(text)
    return diff([str(folder / "a.py"), str(folder / "b.py")], **how)


def text_of(result: Diff) -> str:
    return " ".join(json_of(result)["cause_text"])


def test_runs_are_the_same_whatever_differs_without_effect(tmp_path: Path) -> None:
    other = MARKED.replace('name="gu"', 'name="gu" solimp=".8 .95 .001"')  # it touches nothing
    result = compared(tmp_path, SCRIPT, other)
    printed = json_of(result)
    assert (printed["class"], printed["same_until"], printed["first"]) == ("none", 119, None)
    assert printed["because"] == printed["cause_text"] == []
    assert "geom_solimp" in printed["no_effect"]
    assert report_of(result).code == 0


def test_a_field_of_the_model_is_proved_in_all_steps(tmp_path: Path) -> None:
    result = compared(tmp_path, SCRIPT, HEAVIER.replace("</worldbody>", "<site/></worldbody>"))
    printed = json_of(result)
    assert (printed["class"], printed["same_until"]) == ("model", -1)
    first = printed["because"][0]
    assert (first["field"], first["element"], first["a"], first["b"]) == (
        *("body_mass", "fore"),
        *(0.6, 0.61),
    )
    assert printed["proved"] == {"by": "fields", "steps": 120, "of": 120, "exact": True}
    assert report_of(result).code == 3


def test_an_input_is_named_with_its_step_and_line(tmp_path: Path) -> None:
    result = compared(tmp_path, SCRIPT, PUSHED)
    printed = json_of(result)
    assert (printed["class"], printed["same_until"]) == ("input", 39)
    (cause,) = printed["because"]
    assert (cause["field"], cause["element"], cause["step"]) == ("ctrl", "me", 40)
    assert (cause["a"], cause["b"]) == (0.1, 0.2)
    assert cause["site_b"] == f"b.py:{LINE + 1}"
    assert printed["proved"] == {"by": "inputs", "steps": 120, "of": 120, "exact": True}


def test_a_second_cause_acts_in_its_own_steps(tmp_path: Path) -> None:
    slippery = PUSHED.replace('size=".05 .05 .05"', 'size=".05 .05 .05" friction="1.5"')
    higher = 'pos=".45 0 .1"'  # the cube lands after the push
    both = (text.replace('pos=".45 0 .06"', higher) for text in (SCRIPT, slippery))
    printed = json_of(compared(tmp_path, *both))
    assert printed["class"] == "input"
    assert [each["field"] for each in printed["because"]] == ["ctrl"]
    assert [(each["field"], each["element"]) for each in printed["also"]] == [
        ("geom_friction", "gc")
    ]
    assert printed["proved"]["steps"] < printed["proved"]["of"] == 120


@pytest.mark.parametrize(
    ("change", "cls", "words"),
    some(
        [
            (
                ("d = mujoco.MjData(m)", "d = mujoco.MjData(m); d.qpos[0] = 1e-9"),
                "start",
                "shoulder",
            ),
            (('timestep="0.002"', 'timestep="0.0021"'), "settings", "opt.timestep"),
            (("range(120)", "range(110)"), "length", ""),
            (
                ("    mujoco.mj_step", "    if k == 30: m.body_mass[3] = 0.7\n    mujoco.mj_step"),
                *("model", "body_mass of fore: 0.6 → 0.7 before step 30"),
            ),
        ],
        1,
    ),
)
def test_each_kind_of_cause_is_told(
    change: tuple[str, str], cls: str, words: str, tmp_path: Path
) -> None:
    result = compared(tmp_path, SCRIPT, SCRIPT.replace(*change))
    printed = json_of(result)
    assert printed["class"] == cls
    assert words in text_of(result)
    proved = printed["proved"]
    assert proved is None if cls == "length" else proved["steps"] == proved["of"]
    assert report_of(result).code == 3


def test_the_same_script_that_computes_otherwise_is_no_fault_of_the_engine(tmp_path: Path) -> None:
    script = tmp_path / "s.py"
    script.write_text(
        SCRIPT.replace("0.1 * k), 0.1", "0.1 * k), eval(os.environ['SUM'])").replace(
            "import mujoco", "import os, mujoco", 1
        )
    )
    printed = json_of(diff([str(script)], variables=["SUM=.1 + .2 + .3", "SUM=.3 + .2 + .1"]))
    assert printed["class"] == "host"
    assert printed["because"][0]["element"] == "me"
    assert printed["nudges"]["size"] < 1e-7


def test_steps_within_a_tolerance_are_the_same(tmp_path: Path) -> None:
    nudged = SCRIPT.replace("d = mujoco.MjData(m)", "d = mujoco.MjData(m); d.qpos[0] = 1e-9")
    assert json_of(compared(tmp_path, SCRIPT, nudged, tolerance=1e-3))["class"] == "none"


def test_recordings_are_compared_as_scripts_are(drop: Drop, tmp_path: Path) -> None:
    compared(tmp_path, SCRIPT, HEAVIER, out=tmp_path / "kept")
    kept = [str(tmp_path / "kept" / f"{name}.rrd") for name in "ab"]
    done = drop("diff", *kept, "--json")
    assert done.returncode == 3
    assert json.loads(done.stdout)["because"][0]["field"] == "body_mass"


def test_an_answer_has_at_most_twelve_lines(drop: Drop, tmp_path: Path) -> None:
    much = HEAVIER.replace('name="gc"', 'name="gc" friction="1.5" solref=".03 1"')
    much = much.replace("range(120)", "range(119)") + "    d.qfrc_applied[:] = 0.01 * k\n"
    much += "    if k == 3: mujoco.mj_resetData(m, d)\n    if k == 118: raise ValueError\n"
    much = much.replace('mass="0.61"', 'mass="0.6"')
    much = much.replace(
        "    mujoco.mj_step", "    d.xfrc_applied[1:, :] = 0.1 * k\n    mujoco.mj_step"
    )
    for name, text in (("a.py", SCRIPT), ("b.py", much)):
        (tmp_path / name).write_text(text)
    done = drop("diff", "a.py", "b.py")
    assert done.returncode == 3
    lines = done.stdout.splitlines()
    assert 7 <= len(lines) <= 12
    assert lines[0].startswith("same ")


def test_what_is_needed_least_is_left_out_of_twelve_lines(tmp_path: Path) -> None:
    result = compared(tmp_path, SCRIPT, PUSHED)
    cause = result.answer.because[0]
    also = [replace(cause, steps=3, element=f"joint number {n}") for n in range(9)]
    many = replace(result, answer=replace(result.answer, also=also, no_effect=["geom_solimp"]))
    titles = [fact.title for fact in facts_of(many)]
    fewer = replace(many, answer=replace(many.answer, also=[]))
    assert "no effect" in [fact.title for fact in facts_of(fewer)]
    assert titles[:3] == ["same", "because", "proved"]
    assert "also" in titles
    assert len(many.report().sections[0].blocks[0].rows) <= 12


@pytest.mark.long
def test_steps_correspond_by_their_times_if_that_is_asked_for(tmp_path: Path) -> None:
    begins = SCRIPT.replace("0.3 * np.sin(0.1 * k)", "0.3 * np.sin(50 * d.time)")
    finer = begins.replace('timestep="0.002"', 'timestep="0.001"').replace("(120)", "(240)")
    finer = finer.replace("0.1\n", "0.1 if k < 80 else 0.2\n")
    printed = json_of(compared(tmp_path, begins, finer, align="time"))
    assert (printed["steps"], printed["class"]) == ([120, 120], "settings")
    assert printed["proved"] == {"by": "fields", "steps": 120, "of": 120, "exact": True}
    coarse = begins.replace("0.1\n", "0.1 if k < 80 else 0.2\n")
    later = json_of(compared(tmp_path, begins, coarse, align="time"))
    assert (later["same_until"], later["because"][0]["step"]) == (79, 80)


def test_what_moves_in_one_run_only_is_never_the_same(tmp_path: Path) -> None:
    far = '<body name="far" pos="3 3 1"><freejoint/><geom size=".1"/></body></worldbody>'
    short = SCRIPT.replace("range(120)", "range(10)")
    result = compared(tmp_path, short, short.replace("</worldbody>", far))
    assert json_of(result)["cause_text"] == ["only b.py has far"]
    assert report_of(result).code == 3


def test_a_run_that_fails_is_compared_as_far_as_it_goes(tmp_path: Path) -> None:
    fails = SCRIPT + "    if k == 50: raise ValueError(k)\n"
    result = compared(tmp_path, SCRIPT, fails)
    printed = json_of(result)
    assert (printed["class"], printed["steps"], printed["same_until"]) == ("length", [120, 51], 50)
    assert "b.py failed" in str(result)


def test_the_first_recordings_that_hold_no_frames_are_compared_by_samples(tmp_path: Path) -> None:
    old = tmp_path / "old.rrd"
    old.write_bytes(lzma.decompress((RECORDINGS / "5" / "swing.rrd.xz").read_bytes()))
    result = diff([str(old), str(old)])
    assert (result.answer.cls, result.runs) == ("none", 0)


# -- what is asked for ----------------------------------------------------------------------------


def test_values_given_once_per_side_are_divided_at_the_first_that_is_repeated() -> None:
    a, b = sides_of(["s.py", "--fast"], packages=["mujoco==3.3.7", "mujoco==4.0.0", "numpy==2.0"])
    assert (a.packages, b.packages) == (["mujoco==3.3.7"], ["mujoco==4.0.0", "numpy==2.0"])
    assert a.arguments == b.arguments == ["--fast"]
    a, b = sides_of(["s.py"], variables=["A=1"], arguments=["1 '2 3'"])
    assert (a.variables, b.variables, b.arguments) == ({}, {"A": "1"}, ["1", "2 3"])
    assert [side.target for side in sides_of(["a.py", "b.py"])] == ["a.py", "b.py"]


@pytest.mark.parametrize(
    ("words", "how"),
    [
        ([], {}),
        (["s.py"], {}),
        (["--tolerence", "s.py"], {}),
        (["s.py"], {"packages": ["mujoco"]}),
        (["s.py"], {"variables": ["A"]}),
    ],
)
def test_what_makes_no_two_sides_is_refused(words: list[str], how: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError):
        sides_of(words, **how)


def test_a_version_is_unpacked_once_and_found_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fetched: list[str] = []

    def install(requirement: str, folder: Path, _: str) -> None:
        fetched.append(requirement)
        (folder / "some.py").write_text("")

    monkeypatch.setattr(wheels, "_install", install)
    for _ in range(2):
        found = wheels.unpacked(["some==1.0"], sys.executable, lambda _: None)
        assert (Path(found["PYTHONPATH"].split(os.pathsep)[0]) / "some.py").is_file()
    assert fetched == ["some==1.0"]
    assert wheels.forget() == 1
    assert wheels.forget() == 0


def test_a_version_that_cannot_be_had_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("UV_OFFLINE", "1")
    with pytest.raises(DropError) as raised:
        wheels.unpacked(["no-such-package==1.0"], sys.executable, lambda _: None)
    assert "no-such-package==1.0" in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not [*(tmp_path / "drop" / "with").iterdir()]


# -- parts ----------------------------------------------------------------------------------------


def test_the_smallest_set_is_found_whatever_its_places() -> None:
    for wanted in ({3}, {0, 9}, {2, 3, 7}):
        tried: list[list[int]] = []

        def holds(units: list[int], wanted: set[int] = wanted, tried: Any = tried) -> bool:
            tried.append(units)
            return wanted <= {*units}

        assert {*minimal(range(10), holds)} == wanted
        assert len(tried) < 60


def test_values_have_as_many_digits_as_tell_them_apart() -> None:
    assert values(0.6, 0.61) == ("0.6", "0.61")
    assert values(0.02, 0.020000000001) == ("0.02", "0.020000000001")
    assert values((1.0, 2.0), (1.0, 3.0)) == ("1 2", "1 3")


def test_numbering_that_differs_is_one_swap_where_sizes_are_the_same() -> None:
    """One of the two versions encodes the connections between elements differently."""
    xml = "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
    fields = constants_of(mujoco.MjModel.from_xml_string(xml))
    other = {**fields, "body_simple": fields["body_simple"] + 1}
    matched = Matched(Elements(fields), Elements(other))
    (found,) = FieldsApart(fields, other, matched).swappable
    assert (found.told.field, found.told.is_structure) == ("body_simple", True)
    assert FieldsApart(fields, {**other, "nv": fields["nv"] + 1}, matched).others == ["body_simple"]


@pytest.mark.long
@pytest.mark.skipif(not os.environ.get("OLDER_MUJOCO"), reason="OLDER_MUJOCO names no interpreter")
def test_a_script_without_contact_is_the_same_in_both_versions(tmp_path: Path) -> None:
    script = tmp_path / "s.py"
    script.write_text(SCRIPT.replace('pos=".45 0 .06"', 'pos=".45 0 9"'))
    pythons = [os.environ["OLDER_MUJOCO"], sys.executable]
    printed = json_of(diff([str(script)], pythons=pythons))
    assert (printed["class"], printed["same_until"]) == ("none", 119)


@pytest.mark.long
@pytest.mark.skipif(not os.environ.get("OLDER_MUJOCO"), reason="OLDER_MUJOCO names no interpreter")
def test_another_version_makes_another_step_of_the_same_state(tmp_path: Path) -> None:
    script = tmp_path / "s.py"
    script.write_text(
        """
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
<geom name="table" type="box" size=".5 .5 .05"/>
<body name="crate" pos=".03 0 .27" euler="9 3 0"><freejoint/>
<geom name="side" type="box" size=".1 .08 .06" mass="1"/></body></worldbody></mujoco>''')
d = mujoco.MjData(m)
for _ in range(200): mujoco.mj_step(m, d)
"""
    )
    pythons = [os.environ["OLDER_MUJOCO"], sys.executable]
    printed = json_of(diff([str(script)], pythons=pythons))
    assert printed["class"] == "step"
    (cause,) = printed["because"]
    assert (cause["stage"], sorted(cause["pair"])) == ("collision", ["side", "table"])
    assert "contact" in cause["feature"]


# -- where it is used -----------------------------------------------------------------------------


def test_a_check_that_fails_says_why_and_one_that_need_not_passes(
    drop: Drop, tmp_path: Path
) -> None:
    touchless = MARKED.replace('name="gu"', 'name="gu" solimp=".8 .95 .001"')
    for name, text in (("golden", SCRIPT), ("heavier", HEAVIER), ("same", touchless)):
        (tmp_path / f"{name}.py").write_text(text)
        drop("record", "--no-explain", "--out", f"{name}.rrd", f"{name}.py")
    done = drop("check", "heavier.rrd", "--against", "golden.rrd")
    assert done.returncode == 3
    assert "because     body_mass of fore: 0.6 → 0.61, and what follows" in done.stdout
    printed = json.loads(drop("check", "heavier.rrd", "--against", "golden.rrd", "--json").stdout)
    assert printed["why"]["proved"] == {"by": "fields", "steps": 120, "of": 120, "exact": True}
    same = drop("check", "same.rrd", "--against", "golden.rrd", "--json")
    assert same.returncode == 0
    assert json.loads(same.stdout)["first_difference"] is None


@pytest.mark.long
def test_a_golden_block_holds_what_tells_why(tmp_path: Path) -> None:
    runs = []
    for name, text in (("golden", SCRIPT), ("fresh", HEAVIER)):
        with record(tmp_path / f"{name}.rrd", drawn=False):
            exec(compile(text, name, "exec"), {})
        runs.append(tmp_path / f"{name}.rrd")
    why = check(runs[1], runs[0]).why
    assert isinstance(why, Diff)
    assert [each.field for each in why.answer.because] == ["body_mass"]


def test_a_script_as_it_was_committed_is_beside_its_data(tmp_path: Path) -> None:
    reads = SCRIPT + "print((pathlib.Path(__file__).parent / 'data.txt').read_text())\n"
    reads = reads.replace("import mujoco", "import pathlib, mujoco", 1)
    script = tmp_path / "s.py"
    script.write_text(reads)

    def git(*words: str) -> None:
        who = "-c", "user.name=x", "-c", "user.email=x@example.org"
        subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True)

    git("init", "-q")
    git("add", "s.py")
    git("commit", "-qm", "first")
    (tmp_path / "data.txt").write_text("kept")
    script.write_text(reads.replace('mass="0.6"', 'mass="0.61"'))
    result = diff([str(script)], revision="HEAD")
    assert (result.a, result.b) == ("HEAD", "s.py")
    assert [each.field for each in result.answer.because] == ["body_mass"]
    with pytest.raises(DropError, match="git says"):
        diff([str(script)], revision="no-such")


@pytest.mark.long
def test_pictures_that_a_renderer_draws_otherwise_are_seen(
    drop_process: Drop, tmp_path: Path
) -> None:
    if find_library("EGL") is None:
        pytest.skip("no libEGL; try: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri")
    draws = SCRIPT.replace("for k in", "r = mujoco.Renderer(m, 48, 64)\nfor k in")
    draws = draws.replace("range(120)", "range(6)")
    draws += "    if k > 3: r.update_scene(d); r.render()\n"
    green = draws.replace('name="gc"', 'name="gc" rgba="0 1 0 1"')
    for name, text in (("a.py", draws), ("b.py", green), ("c.py", draws)):
        (tmp_path / name).write_text(text)
    egl = ("--env", "MUJOCO_GL=egl") * 2
    done = drop_process("diff", "a.py", "b.py", *egl, "--out", "kept")
    assert done.returncode == 0, done.stderr
    assert "pictures    2 of 2 differ though states are the same, first after step 4" in done.stdout
    assert "pictures" not in drop_process("diff", "a.py", "c.py", *egl).stdout
    again = drop_process("check", "kept/b.rrd", "--against", "kept/a.rrd", "--json")
    assert json.loads(again.stdout)["frames"]["differing"] == 2


@pytest.mark.parametrize(
    ("callback", "gain", "field"),
    some([("control", "d.ctrl[1] = {} * d.qvel[1]", "ctrl"),
     ("passive", "d.qfrc_passive[1] += {} * d.qvel[1]", "qfrc_passive")], 1),
)  # fmt: skip
def test_what_a_callback_writes_within_a_step_is_an_input(
    callback: str, gain: str, field: str, tmp_path: Path
) -> None:
    sets = "def call(m, d): {}\nmujoco.set_mjcb_{}(call)\nfor k in"
    a, b = (
        SCRIPT.replace("for k in", sets.format(gain.format(value), callback))
        for value in (-0.3, -0.31)
    )
    printed = json_of(compared(tmp_path, a, b))
    assert (printed["class"], printed["because"][0]["field"]) == ("input", field)
    assert printed["proved"]["steps"] == printed["proved"]["of"]

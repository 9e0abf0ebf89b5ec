"""Golden recordings outlive the format: earlier schemas are read, with the same values.

`recordings/N` has, of schema N, a drop of 0.5 s and the script `recordings/arm.py`, as the drop of
that schema recorded them. They are compared with what today's makes of the same.
"""

from __future__ import annotations

import json
import lzma
import shutil
from pathlib import Path
from typing import Any

import pytest
from drop_physics import Scenario, analyze, check, info, record_script, simulate
from drop_physics.errors import RecordingError
from drop_physics.messages import Message
from drop_physics.recording import reader, schema, versions

pytestmark = pytest.mark.pybullet

RECORDINGS = Path(__file__).with_name("recordings")
EARLIER = sorted(int(folder.name) for folder in RECORDINGS.iterdir() if folder.is_dir())
DIGESTS = ("state", "contacts", "series", "calls", "frames")
OWN = ("recording", "layer", "lacks", "findings")
"""Keys of an analysis that depend on the recording, or have more where it contains more."""


@pytest.fixture(scope="module")
def today(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return recordings like the old ones, made by the current version of drop."""
    folder = tmp_path_factory.mktemp("today")
    shutil.copy(RECORDINGS / "arm.py", folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        record_script("arm.py", out="arm.rrd")
    simulate(Scenario(duration_s=0.5), folder / "drop.rrd", camera=None)
    return {name: folder / f"{name}.rrd" for name in ("arm", "drop")}


@pytest.fixture(
    params=[
        pytest.param((number, name), marks=[pytest.mark.long] * (number > EARLIER[0]))
        for number in EARLIER
        for name in ("arm", "drop")
    ],
    ids=str,
)
def pair(
    request: pytest.FixtureRequest, today: dict[str, Path], tmp_path: Path
) -> tuple[Path, Path]:
    """Return a current recording, and one of an earlier schema."""
    number, name = request.param
    golden = tmp_path / f"golden-{name}.rrd"
    golden.write_bytes(lzma.decompress((RECORDINGS / f"{number}/{name}.rrd.xz").read_bytes()))
    return today[name], golden


def test_every_earlier_schema_that_is_read_has_recordings() -> None:
    assert {*range(versions.OLDEST, schema.SCHEMA_VERSION)} <= {*EARLIER}
    assert versions.ADDED.keys() <= {*range(versions.OLDEST + 1, schema.SCHEMA_VERSION + 1)}


def test_they_hold_the_same_bits(pair: tuple[Path, Path]) -> None:
    ended = [reader.read(path).ended or {} for path in pair]
    for name in DIGESTS:
        now, then = (each.get(f"{name}_sha256") for each in ended)
        assert now == then, name


def test_check_compares_with_them(pair: tuple[Path, Path]) -> None:
    for found in (check(*pair), check(*reversed(pair))):
        assert found.same
        assert found.comparison is not None
        assert found.comparison.differences == []
        assert found.comparison.largest_difference_m == 0
        assert found.frames is not None
        assert (found.frames.compared, found.frames.differing) == (pair[0].stem == "arm", 0)


def test_check_sees_what_differs_from_them(pair: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "other.rrd"
    if pair[0].stem == "drop":
        simulate(Scenario(duration_s=0.5, gravity_m_s2=-9.8101), other, camera=None)
    else:
        text = RECORDINGS.joinpath("arm.py").read_text()
        target = "targetPosition=1.7"
        assert target in text
        tmp_path.joinpath("arm.py").write_text(text.replace(target, f"{target}000001"))
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)
            record_script("arm.py", out=other)
    found = check(other, pair[1])
    assert not found.same
    assert found.first is not None
    assert found.first.step in (0, 1)


def test_analyze_finds_the_same_in_them(pair: tuple[Path, Path]) -> None:
    now, then = (json.loads(json.dumps(analyze(path, force=True).as_json())) for path in pair)
    told = [json.dumps(finding) for finding in now["findings"]]
    assert all(json.dumps(finding) in told for finding in then["findings"])
    for each in (now, then):
        for name in OWN:
            each.pop(name)
        # What made it, and where.
        for name in [name for name in each["engine"] if name.endswith("_version")]:
            del each["engine"][name]
        each["origin"] = {"script": (each["origin"] or {}).get("script")}
        # What the script reads is told, and raises other rows; the first schemas lack it.
        told = [row for row in each.get("account", ()) if row["kind"] != "reads"]
        rows = [{**row, "salience": None} for row in told]
        each["account"] = sorted(rows, key=json.dumps)
    assert now == then


def test_info_describes_them(pair: tuple[Path, Path]) -> None:
    now, then = (info(path).as_json() for path in pair)
    own = ("recording", "recording_id", "bytes", "layer", "notes", "engine", "readings")
    assert without(now, *own) == without(then, *own)


def without(values: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in names}


def test_what_they_lack_is_said(
    pair: tuple[Path, Path], drop: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, golden = pair
    monkeypatch.setattr(schema, "SCHEMA_VERSION", 101)
    added = {
        100: versions.Addition(Message("a tail"), of_drops=False),
        101: versions.Addition(Message("whiskers"), of_drops=True),
    }
    monkeypatch.setattr(versions, "ADDED", added)
    (number,) = {(reader.read(golden).ended or {})["schema_version"]}
    what = "whiskers" if now.stem == "drop" else "a tail, whiskers"
    says = f"{golden} is of schema {number}, which lacks {what}"
    assert says in info(golden).notes
    assert analyze(golden, force=True).lacks == says
    assert says in " ".join(drop("analyze", golden).stderr.split())
    assert says in check(now, golden).lacks
    told = " ".join(drop("check", now, "--against", golden).stdout.split())
    assert f"lacks {says}" in told
    assert json.loads(drop("check", now, "--against", golden, "--json").stdout)["lacks"][-1] == says
    assert json.loads(drop("analyze", golden, "--json").stdout)["lacks"] == says
    monkeypatch.setattr(versions, "ADDED", {})
    assert analyze(golden, force=True).lacks is None


def test_others_are_refused(pair: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    _, golden = pair
    (number,) = {(reader.read(golden).ended or {})["schema_version"]}
    monkeypatch.setattr(schema, "SCHEMA_VERSION", number - 1)
    with pytest.raises(RecordingError, match=f"must be of schema {number - 1}, got {number}"):
        reader.read(golden)
    monkeypatch.setattr(schema, "SCHEMA_VERSION", number + 1)
    monkeypatch.setattr(versions, "OLDEST", number + 1)
    with pytest.raises(RecordingError, match="was made by an earlier version of drop"):
        reader.read(golden)

"""Steps that `record` leaves unexplained are explained by `analyze` on request, bitwise equally.

The reference is the recording of the same script that was explained while it was made.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from conftest import some
from drop_physics import analyze, record_script
from drop_physics.engines.mujoco import framed
from drop_physics.explain import moments
from drop_physics.recording import digest
from drop_physics.recording.layer_file import is_layer, layer_of
from drop_physics.recording.layer_sums import sums_in
from drop_physics.recording.reader import read
from drop_physics.stages.analyze import explaining
from drop_physics.stages.analyze.explaining import WhatToExplain, explained
from drop_physics.trace.history import Seen
from mujoco_scripts import MACHINE

SCRIPT = f"""
import mujoco, numpy as np
m = mujoco.MjModel.from_xml_string('''{MACHINE}''')
d = mujoco.MjData(m)
rng = np.random.default_rng(0)
for k in range(600):
    if k % 7 == 0: d.ctrl[:] = rng.uniform(-2, 2, m.nu)
    if k == 150: m.body_mass[2] *= 2
    if k == 200: mujoco.mj_resetData(m, d)
    mujoco.mj_step(m, d)
"""
STEPS = 600


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a recording explained at once, and one without explanation."""
    folder = tmp_path_factory.mktemp("later")
    (folder / "script.py").write_text(SCRIPT)
    script = str(folder / "script.py")
    at_once = record_script(script, out=folder / "once.rrd")
    assert at_once.replay is not None
    assert at_once.replay.explained == STEPS
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(framed, "FEW_STEPS", 100)
        later = record_script(script, out=folder / "later.rrd")
    assert later.replay is None
    assert later.bytes < 0.7 * at_once.bytes
    return at_once.recording, later.recording


few = pytest.mark.usefixtures("counts_as_long")


@pytest.fixture
def counts_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lower the limit above which a run counts as long."""
    monkeypatch.setattr(explaining, "FEW_STEPS", 100)


def acted(seen: Seen, first: int, end: int) -> tuple[dict[Any, Any], dict[int, int], Any]:
    """Return the impulses by cause in steps to the given samples, their statuses, and contacts.

    A cause that is less than the last bit of a step's largest impulse may be there or not.
    """
    piece, found, status = seen.sampled.piece(first, end), dict[Any, Any](), dict[int, int]()
    for part in piece.impulses[0]:
        widths = [len(seen.causes[number].places) for number in part.causes.tolist()]
        values = np.split(part.values, np.cumsum(widths)[:-1])
        steps = np.repeat(part.steps, part.counts)
        for number, step, value in zip(part.causes.tolist(), steps.tolist(), values, strict=True):
            cause = seen.causes[number]
            key = step, cause.kind, cause.name, cause.body
            found.setdefault(key, np.zeros(20))[[*cause.places]] += value
        status |= dict(zip(part.steps.tolist(), part.status.tolist(), strict=True))
    order = np.lexsort(piece.contacts["position_a_m"].T)
    rows = piece.contacts[order]
    return found, status, rows[np.argsort(rows["step"], kind="stable")]


@few
@pytest.mark.parametrize(
    "window", some(map(pytest.param, [(180, 230), (0, 600), (149, 151), (599, 600)]), 1)
)
def test_windows_have_the_sums_of_a_run_that_was_explained_at_once(
    made: tuple[Path, Path], window: tuple[int, int]
) -> None:
    once, later = map(read, made)
    first, end = window
    found = explained(later, WhatToExplain([window]))
    assert found.sums is not None
    assert found.sums.lacking([(0, first, end)]) == []
    mine, status, contacts = acted(found.recording.seen, first + 1, end + 1)
    theirs, statuses, touching = acted(once.seen, first + 1, end + 1)
    assert status == statuses
    assert [*status] == [*range(first + 1, end + 1)]
    np.testing.assert_array_equal(contacts, touching)
    largest: dict[Any, float] = {}
    for key, value in theirs.items():
        largest[key[0]] = max(largest.get(key[0], 0.0), np.abs(value).max())
    for key in mine.keys() | theirs.keys():
        one, other = (each.get(key, np.zeros(20)) for each in (mine, theirs))
        assert np.abs(one - other).max() <= 3e-16 * largest[key[0]], key
    if window != (0, 600):
        assert [*acted(found.recording.seen, 1, STEPS + 1)[1]] == [*status]
        assert f"{end - first:,} of 600 steps are explained" in (found.note or "")


def test_a_short_run_without_its_sums_is_analyzed_as_one_with_them(
    made: tuple[Path, Path], tmp_path: Path
) -> None:
    once, later = (
        json.loads(json.dumps(analyze(path, out=tmp_path / f"{path.stem}.rrd").as_json()))
        for path in made
    )
    for each in (once, later):
        for name in ("recording", "layer", "origin"):
            each.pop(name)
    assert later == once


@few
def test_what_was_explained_is_kept_in_the_layer(
    made: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, later = made
    layer = layer_of(later)
    layer.unlink(missing_ok=True)
    first = analyze(later, explain=WhatToExplain([(300, 320)]))
    assert is_layer(layer)
    assert any("20 of 600 steps" in note for note in first.notes)
    kept = sums_in(layer, read(later).recording_id)
    assert kept is not None
    assert kept.lacking([(0, 290, 330)]) == [(0, 290, 300), (0, 320, 330)]
    with monkeypatch.context() as patch:  # nothing is explained again
        patch.setattr(explaining, "Stepper", None)
        again = analyze(later, explain=WhatToExplain([(305, 315)]))
        assert again.as_json() == first.as_json()
    more = analyze(later, explain=WhatToExplain([(500, 510)]))
    assert any("30 of 600 steps" in note for note in more.notes)
    whole = analyze(later, explain=WhatToExplain(whole=True))
    assert not any("of 600 steps" in note for note in whole.notes)
    assert whole.explained.of == whole.explained.samples


@few
def test_a_damaged_layer_is_made_again(made: tuple[Path, Path]) -> None:
    _, later = made
    layer = layer_of(later)
    analyze(later, explain=WhatToExplain([(10, 20)]))
    recording_id = read(later).recording_id
    assert sums_in(layer, recording_id) is not None
    assert sums_in(layer, "another") is None
    data = bytearray(layer.read_bytes())
    layer.write_bytes(data[: len(data) // 2])
    assert sums_in(layer, recording_id) is None
    analyze(later, explain=WhatToExplain([(10, 20)]), force=True)
    assert sums_in(layer, recording_id) is not None


@few
def test_a_digest_covers_what_a_layer_holds(
    made: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, later = made
    analyze(later, explain=WhatToExplain([(10, 20)]))
    assert sums_in(layer_of(later), read(later).recording_id) is not None
    recording_id = read(later).recording_id
    monkeypatch.setattr(digest.Digests, "impulses", ["0"])
    assert sums_in(layer_of(later), recording_id) is None


@few
def test_states_name_the_windows_of_a_long_run(
    made: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(moments, "SPAN", 20)
    _, later = made
    seen = explained(read(later)).recording.seen
    steps = {step for _, first, end in seen.windows for step in range(first, end)}
    assert {0, 199, 200, STEPS - 1} <= steps  # its start, its reset and its end
    assert len(steps) < 300
    bases = [seen.bases[name].reshape(STEPS + 1, -1) for name in ("velocity_m_s", "spin_rad_s")]
    velocities = np.hstack([*bases, *(joint.velocity for joint in seen.joints.values())])
    assert int(np.abs(velocities).max(axis=1).argmax()) - 1 in steps
    assert int(np.abs(np.diff(velocities, axis=0)).max(axis=1).argmax()) in steps


@few
def test_without_its_version_it_is_said_which_interpreter_would_do(
    made: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, drop: Any
) -> None:
    _, later = made
    layer_of(later).unlink(missing_ok=True)
    monkeypatch.setattr(explaining.metadata, "version", lambda _: "3.3.0")
    found = explained(read(later), WhatToExplain([(0, 10)]))
    assert found.sums is None
    assert f"that takes MuJoCo {mujoco.__version__}" in (found.note or "")
    assert f"pip install mujoco=={mujoco.__version__}" in (found.note or "")
    told = " ".join(drop("analyze", later, "--steps", "0:10").stdout.split())
    assert "--python takes an interpreter that has it" in told


def test_what_numbers_depend_on_besides_the_script_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONHASHSEED", "7")
    (tmp_path / "script.py").write_text(SCRIPT.replace("600", "5"))
    ended = read(record_script(str(tmp_path / "script.py"), out=tmp_path / "a.rrd").recording).ended
    assert ended is not None
    assert ended["made_with_numpy"] == np.__version__
    assert ended["made_with_mujoco"] == mujoco.__version__
    assert ended["made_with_hash_seed"] == "7"
    if "openblas" in Path("/proc/self/maps").read_text():
        assert ended["made_with_blas"]
        assert ended["made_with_blas_threads"] >= 1


@pytest.mark.parametrize("text", ["10", "a:b", "20:10", "5:5", "-1:4"])
def test_windows_that_are_none_are_refused(made: tuple[Path, Path], drop: Any, text: str) -> None:
    done = drop("analyze", made[1], f"--steps={text}")
    assert done.returncode == 2
    assert "--steps must be A:B" in done.stderr

"""The pytest fixture `golden_recording`: a block of Python must do the physics it once did.

    def test_pick(golden_recording):
        with golden_recording("pick"):
            run_my_simulation()

pytest loads this file in every project where `drop` is installed, so it imports nothing heavy until
the fixture records.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

GoldenRecording = Callable[..., AbstractContextManager[None]]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--update-golden`."""
    parser.getgroup("drop").addoption(
        "--update-golden",
        action="store_true",
        help="make what golden_recording records the golden recordings, in golden/ beside the test",
    )


@pytest.fixture
def golden_recording(request: pytest.FixtureRequest, tmp_path: Path) -> GoldenRecording:
    """Record a block, and compare it with `golden/NAME.rrd` beside the test's file.

    `golden_recording(name, tolerance="1e-9")` passes differences in motion of up to that many
    metres; the default, 0, is bit for bit. `pytest --update-golden` writes the golden recordings.
    """
    folder = request.path.parent / "golden"
    update = bool(request.config.getoption("--update-golden"))

    @contextmanager
    def recorded(name: str, tolerance: float | str = 0.0) -> Iterator[None]:
        from drop_physics.errors import DropError
        from drop_physics.stages.record_block import record

        golden, allowed_m = _named(folder, name), _length(tolerance)
        path = tmp_path / f"{name}.rrd"
        path.parent.mkdir(parents=True, exist_ok=True)
        with record(path, force=True):
            yield
        try:
            failure = _failure(path, golden, allowed_m, update=update)
        except DropError as error:
            failure = str(error)
        if failure:
            pytest.fail(failure, pytrace=False)

    return recorded


def _named(folder: Path, name: str) -> Path:
    """Return the golden recording of a name, which may not lead out of the folder."""
    parts = Path(name).parts
    if not parts or Path(name).is_absolute() or ".." in parts:
        pytest.fail(
            f"golden_recording: the name must be that of a file in {folder}, got {name!r}; "
            'write for example golden_recording("pick")',
            pytrace=False,
        )
    return folder / f"{name}.rrd"


def _length(tolerance: float | str) -> float:
    """Return a tolerance in metres; `check` says which are allowed."""
    try:
        return float(tolerance)
    except (TypeError, ValueError):
        pytest.fail(
            f"golden_recording: the tolerance must be a number of metres, got {tolerance!r}; "
            'write for example tolerance="1e-9"',
            pytrace=False,
        )


def _failure(path: Path, golden: Path, tolerance_m: float, *, update: bool) -> str:
    """Compare a block's recording with the golden one, or replace that; return what is wrong."""
    from drop_physics.recording.reader import read
    from drop_physics.stages.check import check

    if not any(samples > 1 for samples in read(path).seen.samples.values()):
        return (
            "golden_recording: the block recorded no step of a simulation; call stepSimulation in "
            "it, and as p.stepSimulation() with `import pybullet as p`: functions imported by name "
            "(from pybullet import stepSimulation) are not seen"
        )
    if update:
        golden.parent.mkdir(parents=True, exist_ok=True)
        check(path, golden, tolerance_m=tolerance_m, update=True)
        return ""
    if not golden.exists():
        return f"there is no golden recording {golden}; make it with: pytest --update-golden"
    checked = check(path, golden, tolerance_m=tolerance_m)
    if checked.same:
        return ""
    return (
        f"{checked}\nif the change is intended: pytest --update-golden; to look at both: "
        f"drop view {path} {golden}"
    )

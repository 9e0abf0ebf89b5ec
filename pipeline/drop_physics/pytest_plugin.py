"""The pytest fixture `golden_recording`: a block of Python must do the physics it once did.

    def test_pick(golden_recording):
        with golden_recording("pick"):
            run_my_simulation()

pytest loads this file in every project where `drop` is installed, so it imports nothing heavy until
the fixture is used.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
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
def golden_recording(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[GoldenRecording]:
    """Record a block, and compare it with `golden/NAME.rrd` beside the test's file.

    `golden_recording(name, tolerance="1e-9")` passes differences in motion of up to that many
    metres; the default, 0, is bit for bit. `pytest --update-golden` writes the golden recordings.
    What is done with PyBullet from here to the first block, as by fixtures after this one, belongs
    to its recording.
    """
    from drop_physics.errors import DropError
    from drop_physics.stages.record_block import record

    folder = request.path.parent / "golden"
    update = bool(request.config.getoption("--update-golden"))
    first = tmp_path / "golden_recording.rrd"
    watching = ExitStack()
    begun = [watching.enter_context(record(first, drawn=not update))]

    @contextmanager
    def recorded(name: str, tolerance: float | str = 0.0) -> Iterator[None]:
        golden, allowed_m = _named(folder, name), _length(tolerance)
        path = tmp_path / f"{name}.rrd"
        path.parent.mkdir(parents=True, exist_ok=True)
        if not begun:
            begun.append(watching.enter_context(record(first, drawn=not update, force=True)))
        block = begun.pop()
        before = block.steps
        with watching:
            yield
        first.replace(path)
        try:
            failure = (
                NO_STEP
                if block.steps == before
                else _failure(path, golden, allowed_m, update=update)
            )
        except DropError as error:
            failure = str(error)
        if failure:
            pytest.fail(failure, pytrace=False)

    yield recorded
    with contextlib.suppress(DropError):  # of what nobody asked for
        watching.close()


NO_STEP = (
    "golden_recording: the block recorded no step of a simulation; call stepSimulation in it, and "
    "as p.stepSimulation() with `import pybullet as p`: functions imported by name (from pybullet "
    "import stepSimulation) are not seen"
)


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
    from drop_physics.stages.check import check

    if update:
        golden.parent.mkdir(parents=True, exist_ok=True)
        check(path, golden, tolerance_m=tolerance_m, update=True)
        return ""
    if not golden.exists():
        return f"there is no golden recording {golden}; make it with: pytest --update-golden"
    checked = check(path, golden, tolerance_m=tolerance_m)
    if checked.same:
        return ""
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        from drop_physics.console.show_check import append_summary

        append_summary(checked, Path(summary))
    return (
        f"{checked}\nif the change is intended: pytest --update-golden; to look at both: "
        f"drop view {path} {golden}"
    )

"""The pytest fixture `golden_recording`: checks that a block of Python repeats recorded physics.

    def test_pick(golden_recording):
        with golden_recording("pick"):
            run_my_simulation()

pytest loads this file in every environment in which `drop` is installed, so it imports no large
library. Those are imported by a separate process, which records and compares for the whole pytest
run.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from drop_physics.stages.block import BlockWriter

GoldenRecording = Callable[..., AbstractContextManager[None]]
WRITERS: pytest.StashKey[list[BlockWriter]] = pytest.StashKey()
"""Key under which pytest's configuration stores the recording processes: one, or more for nested
blocks."""
JUDGE = "drop_physics.report.golden:failure"


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

    `golden_recording(name, tolerance="1e-9")` accepts differences in motion of up to so many
    metres; the default is `tolerance` in `[tool.drop]` of pyproject.toml, otherwise 0, which
    requires equal bits. `pytest --update-golden` writes the golden recordings. Calls of PyBullet
    between this fixture and the first block, such as those of later fixtures, are included in the
    first recording.
    """
    from drop_physics.errors import DropError
    from drop_physics.stages.block import Block, BlockWriter, record
    from drop_physics.stages.settings import settings

    folder = request.path.parent / "golden"
    try:
        standard_m = settings(request.config.invocation_params.dir).tolerance_m
    except DropError as error:
        pytest.fail(str(error), pytrace=False)
    update = bool(request.config.getoption("--update-golden"))
    first = tmp_path / "golden_recording.rrd"
    watching = ExitStack()

    def begin() -> tuple[BlockWriter, Block]:
        writers = request.config.stash.setdefault(WRITERS, [])
        writer = next((each for each in writers if each.idle), None)
        if writer is None:
            writers.append(writer := BlockWriter())
            request.config.add_cleanup(writer.close)
        # Verified as it is compared: that reads all of it.
        block = record(first, drawn=not update, verified=False, force=True, writer=writer)
        return writer, watching.enter_context(block)

    begun = [begin()]

    @contextmanager
    def recorded(name: str, tolerance: float | str | None = None) -> Iterator[None]:
        golden, allowed_m = _named(folder, name), _length(tolerance, standard_m)
        path = tmp_path / f"{name}.rrd"
        path.parent.mkdir(parents=True, exist_ok=True)
        writer, block = begun.pop() if begun else begin()
        before = block.steps
        with watching:
            yield
        first.replace(path)
        summary = os.environ.get("GITHUB_STEP_SUMMARY")
        try:
            failure = NO_STEP
            if block.steps != before:
                writer.ask(JUDGE, name, path, golden, allowed_m, update, summary)
                failure = writer.answer()
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
    """Return the path of a golden recording from its name, which must stay inside the folder."""
    parts = Path(name).parts
    if not parts or Path(name).is_absolute() or ".." in parts:
        pytest.fail(
            f"golden_recording: the name must be that of a file in {folder}, got {name!r}; "
            'write for example golden_recording("pick")',
            pytrace=False,
        )
    return folder / f"{name}.rrd"


def _length(tolerance: float | str | None, standard_m: float) -> float:
    """Return a tolerance in metres, or the standard one for None; `check` limits its values."""
    try:
        return standard_m if tolerance is None else float(tolerance)
    except (TypeError, ValueError):
        pytest.fail(
            f"golden_recording: the tolerance must be a number of metres, got {tolerance!r}; "
            'write for example tolerance="1e-9"',
            pytrace=False,
        )

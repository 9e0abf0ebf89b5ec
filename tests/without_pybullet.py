"""Select tests without PyBullet: those that need it are left out where it is not installed.

A test needs it if it is marked `pybullet`, takes a fixture that drops the box in PyBullet, or is in
a module that imports it, itself or through others of ours. This is part of `conftest`.
"""

from __future__ import annotations

import ast
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import drop_physics
import pytest

TESTS = Path(__file__).parent
FOLDERS = TESTS, TESTS.parent / "docs", Path(drop_physics.__file__).parents[1]
"""Folders of our modules: of tests, documents, and the package."""
THEIRS = {"pybullet", "pybullet_data", "drop_physics.engines.pybullet.engine"}
"""Modules that cannot be imported without PyBullet."""
FIXTURES = {"standard"}
"""Fixtures that need PyBullet."""
IS_HERE = find_spec("pybullet") is not None


@cache
def _file_of(name: str) -> Path | None:
    """Return the file of one of our modules."""
    files = (folder / f"{name.replace('.', '/')}.py" for folder in FOLDERS)
    return next((file for file in files if file.is_file()), None)


@cache
def imported(module: Path) -> frozenset[str]:
    """Return the modules that a module imports at its own import."""
    names = set[str]()
    for node in ast.parse(module.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(names)


@cache
def imports_pybullet(module: Path) -> bool:
    """Return whether a module imports PyBullet, directly or through our other modules."""
    known, left = {module}, [module]
    while left:
        names = imported(left.pop())
        if names & THEIRS:
            return True
        files = {file for name in names if (file := _file_of(name))}
        left += [*(files - known)]
        known |= files
    return False


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Ignore test modules that cannot be imported without PyBullet."""
    is_module = collection_path.suffix == ".py"
    return True if is_module and not IS_HERE and imports_pybullet(collection_path) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect tests that need PyBullet if it is not installed."""
    if not IS_HERE:
        needing = {item for item in items if _needs(item)}
        config.hook.pytest_deselected(items=[*needing])
        items[:] = [item for item in items if item not in needing]


def _needs(item: pytest.Item) -> bool:
    fixtures = set(getattr(item, "fixturenames", ()))
    marked = item.get_closest_marker("pybullet") is not None
    return marked or bool(fixtures & FIXTURES) or imports_pybullet(item.path)

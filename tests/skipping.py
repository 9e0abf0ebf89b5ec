"""Handling of skipped tests, which CI forbids; `test_docs` uses this file as a `conftest`."""

from __future__ import annotations

import os
from collections.abc import Generator
from importlib.util import find_spec

import pytest


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that needs dependencies from `[dev]` if they are not installed."""
    for mark in item.iter_markers("needs"):
        (module,) = mark.args
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed; try: pip install '.[dev]'")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Report a skipped test as failed in CI, where all dependencies are installed.

    But CI runs `pytest` with `[test]` first, and then, with `[dev]`, `pytest -m "needs or long"`.
    """
    report = yield
    first = "needs" not in item.config.option.markexpr
    later = item.get_closest_marker("needs") is not None and first
    if report.skipped and os.environ.get("CI") and not later:
        report.outcome = "failed"
        report.longrepr = f"in CI nothing is skipped: {report.longrepr}"
    return report

"""Processes that work for us, and import beside their answers."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.workers import Worker

SLOW = """
import pathlib, time
while not pathlib.Path({gate!r}).exists():
    time.sleep(0.01)
"""
ASKED = """
import sys
def loaded(*arguments):
    return hasattr(sys.modules.get("slow"), "pathlib"), hasattr(sys.modules.get("slow"), "DONE")
"""


def test_what_is_loading_is_waited_for_where_it_could_be_seen_half_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = tmp_path / "gate"
    (tmp_path / "slow.py").write_text(SLOW.format(gate=str(gate)) + "DONE = True\n")
    (tmp_path / "known.py").write_text(ASKED)
    (tmp_path / "other.py").write_text(ASKED)
    monkeypatch.syspath_prepend(tmp_path)
    with Worker() as worker:
        worker.ask("known:loaded")
        assert worker.answer() == (False, False)
        worker.load("slow")
        for _ in range(1000):
            # Its answers do not wait: it has imported what it needs.
            worker.ask("known:loaded")
            begun, done = worker.answer()
            assert not done
            if begun:
                break
        assert begun
        worker.ask("other:loaded", tmp_path)
        gate.touch()
        assert worker.answer() == (True, True)


def test_what_a_function_raises_is_raised_here_and_the_next_question_answered() -> None:
    with Worker() as worker:
        worker.ask("math:sqrt", -1)
        worker.ask("math:sqrt", 4)
        with pytest.raises(ValueError, match=r"math domain|nonnegative"):
            worker.answer()
        assert worker.answer() == 2

"""Run scripts as `drop record` does, without the recorder: return their output and events."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import scripts
from drop_physics.engines.decoder import Decoder
from drop_physics.engines.script import Program, Script
from drop_physics.trace.calls import text_of
from drop_physics.trace.events import Calls, Ending, Event, Site


def bare(folder: Path, text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a folder, unwatched."""
    return subprocess.run(
        [sys.executable, _written(folder, text), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def watched(
    folder: Path, text: str, *arguments: str, **how: Any
) -> tuple[list[Event], Ending, str]:
    """Run a script in a folder, and return its events, its ending and its output."""
    name, back = _written(folder, text), Path.cwd()
    os.chdir(folder)
    try:
        with Path("printed.txt").open("wb") as printed, Path("said.txt").open("wb") as said:
            program = Program(name, arguments, sys.executable, **how)
            with Script(program, stdout=printed.fileno(), stderr=said.fileno()) as script:
                events = list(script.events())
                ending = script.ending()
    finally:
        os.chdir(back)
    return events, ending, folder.joinpath("printed.txt").read_text()


RECORDED = """
import contextlib, os, tempfile
from drop_physics.engines.watching import ending, start
from drop_physics.engines.watching.pipe import SHARED_BYTES
@contextlib.contextmanager
def recorded(name):
    with tempfile.TemporaryFile() as block:
        block.truncate(SHARED_BYTES)
        stream = os.open(name, os.O_WRONLY | os.O_CREAT)
        watch = start.watch(stream, os.dup(block.fileno()), steps=None, duration_s=None,
            keep_sleeping=False, seed=None)
        try:
            yield
        finally:
            ending.end(watch, "finished")
            watch.remove()
            watch.pipe.close()
"""


def blocks(folder: Path, text: str) -> tuple[subprocess.CompletedProcess[str], list[Recorded]]:
    """Run a script that records blocks to the files `0`, `1` …, and return the events in each."""
    folder.joinpath("recorded.py").write_text(RECORDED)
    done, found = bare(folder, "from recorded import recorded\n" + text), []
    for number in range(9):
        if folder.joinpath(str(number)).exists():
            decoder = Decoder()
            events = list(decoder.feed(folder.joinpath(str(number)).read_bytes()))
            found.append(Recorded([*events, *decoder.rest()], decoder))
    return done, found


class Recorded(NamedTuple):
    """The events sent within a `with` block, and their decoder."""

    events: list[Event]
    decoder: Decoder


def _written(folder: Path, text: str) -> str:
    folder.joinpath("show.py").write_text(scripts.SHOW)
    folder.joinpath("script.py").write_text(text)
    return "script.py"


def told(events: list[Event]) -> list[tuple[str, str, int]]:
    """Return function, arguments as text, and line of all calls, in order."""
    sites = {event.number: event for event in events if isinstance(event, Site)}
    found = []
    for calls in (event for event in events if isinstance(event, Calls)):
        rest = iter(calls.numbers.tolist())
        for call, which in zip(calls.calls, calls.sites, strict=True):
            site = sites[which]
            text = text_of(site, [next(rest) for _ in site.names])
            found.append((int(call), site.function, text, site.line))
        assert list(rest) == []
    assert [call for call, *_ in sorted(found)] == list(range(1, len(found) + 1))
    return [tuple(rest) for _, *rest in sorted(found)]

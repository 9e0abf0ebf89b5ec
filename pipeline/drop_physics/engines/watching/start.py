"""Starts the watching of a script's use of its engines."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from . import ENGINES, asserted, numerics
from .clock import Clock
from .draws import Draws
from .edits import Edit
from .host import ScriptWatch
from .pipe import Pipe
from .private import Private
from .sites import HOME


def watch(
    pipe: int,
    block: int,
    *,
    steps: int | None,
    duration_s: float | None,
    keep_sleeping: bool,
    seed: int | None,
    of_first: bool = False,
    begins_s: float | None = None,
    variation: dict[str, Any] | None = None,
    interventions: Sequence[dict[str, Any]] = (),
    asks: Mapping[str, int] | None = None,
    streams: bool = True,
    evaluator: Mapping[str, Any] | None = None,
    private: Private | None = None,
    edits: Sequence[Edit] = (),
    keeps_files: bool = False,
    again: bool = False,
) -> ScriptWatch:
    """Watch all engines, each from the moment that the script imports it.

    Parameters
    ----------
    pipe, block
        File descriptors of the pipe, and of the memory shared with its reader.
    steps, duration_s
        When to stop the script; None for never.
    keep_sleeping
        Whether the script's clock is the real one.
    seed
        Seed of all random numbers, or None.
    of_first
        Whether only steps of the engine that steps first count.
    begins_s
        What a virtual clock shows at first [s]; None for the time of day.
    variation
        What varies in the run, as each engine takes it; None for the script's own run.
    interventions
        What its calls do otherwise, likewise.
    asks, streams, evaluator
        How trials are asked for that part from this run, whether it sends what happens, and what is
        evaluated in it, as `ScriptWatch` takes them.
    private
        The view of the file system that this process has entered; None for the machine's own.
    edits
        Parts of the script's text that are other ones.
    keeps_files
        Whether to send the contents of files that an engine loads.
    again
        Whether this program has replaced another one that was watched.
    """
    started = ScriptWatch(
        Pipe(pipe, block, again=again),
        Clock(real=keep_sleeping, begins_s=begins_s),
        steps=steps,
        duration_s=duration_s,
        of_first=of_first,
        asks=asks,
        streams=streams,
        evaluator=evaluator,
        is_plain=not (variation or interventions or edits or asks),
        private=private,
        edits=edits,
    )
    started.keeps_files = keeps_files
    version = ".".join(map(str, sys.version_info[:3]))
    started.pipe.note(
        "python",
        version=version,
        machine=platform.machine(),
        virtual_time=not keep_sleeping,
        hash_seed=numerics.hashes(),
    )
    started.on_import("numpy", lambda numpy: started.tell("python", **numerics.of_numpy(numpy)))
    started.clock.install()
    started.lock.install()
    draws = Draws(seed, started.tell_draw)
    draws.begin()
    started.on_removal(draws.remove)
    started.on_import("numpy.random", draws.on_numpy)
    started.environments.listen()
    if evaluator is not None or asks is not None:
        asserted.install(started)
    for engine in ENGINES:
        its = import_module(f"..{engine}.watch", __package__)
        its.begin(started, interventions, variation)
    return started


def enter(scratch: str | None) -> None:
    """Change to a copy of the working directory, but show paths of the original."""
    if scratch is not None:
        HOME.append(os.getcwd())
        os.chdir(scratch)

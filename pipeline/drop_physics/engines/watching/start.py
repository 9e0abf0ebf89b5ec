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
    """Watch all engines, each as soon as the script imports it.

    Parameters
    ----------
    pipe, block
        File descriptors of the pipe, and of the memory shared with the recorder.
    steps, duration_s
        The number of steps and the time on the script's clock [s] after which the script is ended;
        None for no limit.
    keep_sleeping
        Whether the script's clock is the real one, so that it really sleeps.
    seed
        Seed of all random generators, or None.
    of_first
        Whether only steps of the engine that makes the first step count.
    begins_s
        The time at which a virtual clock starts [s]; None for the current time.
    variation
        The variation of the run, in the form that each engine takes; None in the script's own run.
    interventions
        The operations that change the run, in the form that each engine takes.
    asks, streams, evaluator
        The arguments of the same names of `ScriptWatch`: requests for trials, whether steps and
        calls are sent, and the evaluator.
    private
        The private view of the file system that this process has entered; None for the real file
        system.
    edits
        The replacements in the script's text.
    keeps_files
        Whether the contents of files that an engine loads are sent.
    again
        Whether this program has replaced another watched program (`os.exec…`).
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

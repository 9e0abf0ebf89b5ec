"""Explains steps of a recording that were not explained right after recording."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

from drop_physics.engines.mujoco.framed import FEW_STEPS
from drop_physics.engines.mujoco.later import explained_later
from drop_physics.engines.mujoco.stepping import Stepper
from drop_physics.errors import DropError
from drop_physics.explain.moments import moments_of
from drop_physics.explain.times import StepTimes
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.layer_sums import sums_in
from drop_physics.recording.reader import Recording
from drop_physics.temporary import temporary_folder
from drop_physics.trace.history import Seen
from drop_physics.trace.sums import LaterSums, Window, WithSums
from drop_physics.workers import users_environment

AROUND = 25
"""Number of steps explained before and after a requested time."""
VERSION = "from importlib.metadata import version; print(version('mujoco'))"
"""Program that prints the version of MuJoCo in an interpreter."""


@dataclass(frozen=True)
class WhatToExplain:
    """The steps of a recording to explain, in addition to those explained before."""

    steps: Sequence[tuple[int, int]] = ()
    """Ranges of samples, for all simulations; they contain the steps between these samples."""
    at_s: Sequence[float] = ()
    """Times around which steps are explained [s]."""
    window: Window | None = None
    """The steps that the account describes; findings may cite only these, so they are explained
    first."""
    whole: bool = False
    """Whether to explain all steps."""


BY_DEFAULT = WhatToExplain()


@dataclass(frozen=True)
class LaterExplained:
    """A recording, completed by steps that were explained later."""

    recording: Recording
    sums: LaterSums | None
    """Sums explained after the recording was made; None if there are none."""
    note: Message | None
    """Remark on steps that are not explained, with the command that would explain them."""


def explained(
    recording: Recording,
    what: WhatToExplain = BY_DEFAULT,
    *,
    layer: Path | None = None,
    python: str | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> LaterExplained:
    """Replay and explain steps of a recording whose engine can replay them.

    Earlier explanations are kept. A short run is explained as a whole; of a longer run, only the
    requested ranges of steps are, or ranges chosen by its states (`explain.moments`).

    Parameters
    ----------
    recording
        The recording.
    what
        The steps to explain.
    layer
        The layer in which earlier explanations may be stored.
    python
        The interpreter in which steps are replayed; None for the script's or drop's own.
    progress
        A function that is called with the number of explained steps, and of all steps to explain.
    """
    seen, steps = recording.seen, recording.steps
    done = any(entity.startswith(f"{schema.IMPULSES}/") for entity in recording.entities)
    if not seen.can_replay or done or isinstance(seen.sampled, WithSums):
        return LaterExplained(recording, None, None)
    count = {client: steps.steps_of(client) for client in steps.clients}
    sums = sums_in(layer, recording.recording_id) if layer is not None else None
    sums = LaterSums() if sums is None else sums
    lacking = sums.lacking(_windows(seen, count, what))
    failed: Message | None = None
    if lacking:
        (version,) = {model.engine.partition(" ")[2] for model in steps.models.values()}
        kept = (recording.ended or {}).get("interpreter")
        chosen, failed = _interpreter(version, python, kept)
        if chosen is not None:
            try:
                _explain(recording, sums, lacking, chosen, version, progress)
            except DropError as error:
                failed = Message("its steps are not explained: {why}", why=str(error))
    if not sums.windows:
        return LaterExplained(recording, None, failed)
    made = sum(end - first for _, first, end in sums.windows)
    total = sum(count.values())
    note = failed
    if note is None and made < total:
        note = Message(
            "{made:,} of {steps} are explained: --steps A:B explains others, --all all",
            made=made,
            steps=counted(total, "step"),
        )
    known = sums.seen(seen, whole=made >= total)
    return LaterExplained(replace(recording, seen=known), sums, note)


def _explain(
    recording: Recording,
    sums: LaterSums,
    windows: Sequence[Window],
    python: str,
    version: str,
    progress: Callable[[int, int], None],
) -> None:
    """Replay and explain ranges of steps in an interpreter that has the engine."""
    seen = recording.seen
    times = {each.client: StepTimes(seen, each.client) for each in seen.settings}
    firsts: dict[int, int] = {}
    for number, body in sorted(seen.bodies.items()):
        firsts.setdefault(body.client, number)
    wanted = sum(end - first for _, first, end in windows)
    before = sum(end - first for _, first, end in sums.windows)
    with temporary_folder() as folder, Stepper(python, version) as stepper:
        events = explained_later(
            stepper,
            recording.steps,
            windows,
            firsts=firsts,
            causes=sums.causes,
            times_s=lambda client, steps: times[client].of_all(steps),
            folder=folder,
        )
        for event in events:
            sums.add([event])
            progress(sum(end - first for _, first, end in sums.windows) - before, wanted)


def _windows(seen: Seen, count: Mapping[int, int], what: WhatToExplain) -> list[Window]:
    """Return the step ranges to explain: requested ones, or those with the largest velocities."""
    whole = [(client, 0, n) for client, n in count.items() if n]
    if what.whole or sum(count.values()) < FEW_STEPS:
        return whole
    asked = [*what.steps]
    windows = [
        (client, max(first, 0), min(end, n))
        for client, n in count.items()
        for first, end in asked
        if first < n and end > first
    ]
    for client, n in count.items():
        times = StepTimes(seen, client)
        for time_s in what.at_s:
            step = times.nearest(time_s, 0, n)
            if step is not None:
                windows.append((client, max(step - AROUND, 0), min(step + AROUND, n)))
    if windows:
        return windows
    return [*moments_of(seen, count), *([] if what.window is None else [what.window])]


def _interpreter(
    version: str, python: str | None, recorded: str | None
) -> tuple[str | None, Message | None]:
    """Return an interpreter that has this version of MuJoCo, or the reason why there is none."""
    found: list[str] = []
    candidates = [python] if python else [*([recorded] if recorded else []), sys.executable]
    for each in candidates:
        path = str(Path(each).expanduser())
        has = version_in(path)
        if has == version:
            return path, None
        found.append(f"{each}: {has or '–'}")
    return None, Message(
        "its steps are not explained: that takes MuJoCo {version} (here are {found}); --python "
        "takes an interpreter that has it: pip install mujoco=={version}",
        version=version,
        found=", ".join(found),
    )


def version_in(python: str) -> str:
    """Return the version of MuJoCo in an interpreter; empty if it lacks MuJoCo or cannot be run."""
    if python == sys.executable:
        try:
            return metadata.version("mujoco")
        except metadata.PackageNotFoundError:
            return ""
    try:
        done = subprocess.run(
            [python, "-c", VERSION],
            capture_output=True,
            text=True,
            check=False,
            env=users_environment(),
        )
    except OSError:
        return ""
    return done.stdout.strip() if not done.returncode else ""

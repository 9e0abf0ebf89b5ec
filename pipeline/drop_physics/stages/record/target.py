"""Chooses the path of a script's recording, and which earlier recording it replaces.

The recording is written under a free name, and replaces the earlier recording only when it is
complete. A recording without a step does not replace one with steps.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from drop_physics.errors import RecordingError, ScenarioError, check_suffix
from drop_physics.files.outputs import check_target, make_folder, numbered, reserved
from drop_physics.recording.contents import properties_of
from drop_physics.recording.layer_file import forget_trials, is_layer, layer_of
from drop_physics.recording.reader import listed, recording_id
from drop_physics.recording.schema import RECORDING_PROPERTY
from drop_physics.stages.found import FOLDER, is_of, origin_of, stem_of


@dataclass(frozen=True)
class Earlier:
    """A recording that may be replaced, as it was before the script ran."""

    path: Path
    status: os.stat_result

    def is_unchanged(self) -> bool:
        """Return whether the file is still the same: another process may have replaced it."""
        try:
            now = self.path.stat()
        except OSError:
            return False
        return os.path.samestat(now, self.status) and now.st_mtime_ns == self.status.st_mtime_ns


@dataclass(frozen=True)
class Target:
    """The path of a new recording, and the earlier recordings that it may replace."""

    path: Path
    """Path under which the recording is written."""
    earlier: list[Earlier] = field(default_factory=list)
    """Recordings that may be replaced; the new recording gets the name of the first."""

    @property
    def name(self) -> str:
        """Name of the recording in Rerun's lists."""
        return (self.earlier[0].path if self.earlier else self.path).stem

    def settled(self, *, stepped: bool) -> Path:
        """Give the finished recording its final name, and return its path."""
        without_step = (each for each in self.earlier if not _has_step(each.path))
        for each in self.earlier[:1] if stepped else without_step:
            if each.is_unchanged():
                _replace(each.path, self.path)
                return each.path
        return self.path


@contextlib.contextmanager
def target_of(
    script: str,
    out: Path | str | None,
    *,
    is_module: bool,
    keep: bool,
    force: bool,
    engine: str = "",
) -> Iterator[Target]:
    """Yield the path of the recording to write.

    Parameters
    ----------
    script, is_module
        The script's path, or a module's name.
    out
        The recording's path; None for one in the folder `recordings`, named after the script.
    keep
        Whether earlier recordings of the script are kept.
    force
        Whether any existing file of this name is replaced.
    engine
        For a script that uses two engines, the engine of the second recording, which is added to
        its name, with a number if necessary; empty for the first recording.

    Raises
    ------
    ScenarioError
        If `keep` is given with `out` or `force`, or the name does not end in .rrd.
    OutputError
        If the recording cannot be written.
    """
    if keep and (out is not None or force):
        raise ScenarioError(
            "--keep numbers recordings that are given no name; omit it, or --out and --force"
        )
    beside = f"-{engine.lower()}" if engine else ""
    if out is not None and engine:
        with reserved(Path(out).parent, Path(out).stem + beside) as path:
            yield Target(path)
        return
    if out is not None:
        path = Path(out)
        check_target(path, force=force)
        check_suffix("--out", path, (".rrd",))
        yield Target(path)
        return
    make_folder(FOLDER)
    stem = stem_of(script) + beside
    with reserved(FOLDER, stem) as path:
        earlier = [] if keep else [*_earlier(stem, path, script, is_module=is_module, force=force)]
        yield Target(path, earlier)


def _earlier(
    stem: str, free: Path, script: str, *, is_module: bool, force: bool
) -> Iterator[Earlier]:
    """Yield a script's earlier recordings, whose names are numbered below the first free one."""
    for path in numbered(FOLDER, stem):
        if path == free:
            return
        if path.is_symlink() or not path.is_file():
            continue
        status, origin = path.stat(), origin_of(path)
        ours = origin is not None and is_of(origin, script, is_module=is_module)
        if ours or (force and path.stem == stem):  # force is about the name without a number
            yield Earlier(path, status)


def _has_step(path: Path) -> bool:
    """Return whether a recording has at least one step; True if it cannot be read."""
    try:
        closing = properties_of(path).get(RECORDING_PROPERTY, {})
    except RecordingError:
        return True
    clients = len(listed(closing.get("samples_of_clients")))
    return bool(closing.get("samples", 0) > clients)  # each has one before its first step


def _replace(earlier: Path, path: Path) -> None:
    """Replace an earlier recording by a new one; delete its analysis layer and trials."""
    layer, theirs = layer_of(earlier), None
    with contextlib.suppress(RecordingError):
        theirs = recording_id(earlier)
    path.replace(earlier)
    with contextlib.suppress(RecordingError):
        if layer.is_file() and is_layer(layer) and recording_id(layer) == theirs:
            layer.unlink()
    forget_trials(earlier)

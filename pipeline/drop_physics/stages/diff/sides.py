"""The two sides of a comparison: a script with its arguments and environment, or a recording."""

from __future__ import annotations

import os
import shlex
import sys
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from drop_physics.engines import script as running
from drop_physics.engines.reached import Reached
from drop_physics.engines.script import OTHER_PERTURB, PERTURB, Program
from drop_physics.errors import ScenarioError
from drop_physics.recording import schema
from drop_physics.recording.reader import Recording, read
from drop_physics.stages import verbs
from drop_physics.stages.analyze.explaining import version_in
from drop_physics.stages.diff.revision import exported
from drop_physics.stages.diff.wheels import checked, kept, unpacked
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import checked_limits, digest_of_script, texts_of
from drop_physics.stages.record import interrupts, origin_of, written
from drop_physics.stages.rerun.again import Again, folders_of, is_offered

RECORDING = ".rrd"


@dataclass(frozen=True)
class Asked:
    """One side of a comparison, as requested on the command line."""

    target: str
    arguments: Sequence[str] = ()
    packages: Sequence[str] = ()
    """Package versions for this side, such as `mujoco==3.3.7`."""
    variables: Mapping[str, str] = field(default_factory=dict)
    python: str | None = None
    revision: str | None = None
    """Git revision of the script to run; None for the file as it is."""
    is_second: bool = False
    """Whether uninitialised memory gets other contents than for the first side."""

    @property
    def is_recording(self) -> bool:
        """True if this side is an existing recording."""
        return self.target.endswith(RECORDING)

    def named(self, other: Asked) -> str:
        """Return a short text that distinguishes this side from the other."""
        if self.target != other.target:
            return Path(self.target).name
        words = [package.replace("==", " ") for package in self.packages]
        words += [f"{name}={value}" for name, value in self.variables.items()]
        words += [shlex.join(self.arguments)] if self.arguments != other.arguments else []
        words += [self.python] if self.python and self.python != other.python else []
        words += [self.revision] if self.revision else []
        return ", ".join(words)


def sides_of(
    words: Sequence[str],
    *,
    packages: Sequence[str] = (),
    arguments: Sequence[str] = (),
    variables: Sequence[str] = (),
    pythons: Sequence[str] = (),
    twice: bool = False,
    revision: str | None = None,
) -> tuple[Asked, Asked]:
    """Build both sides of a comparison from the words and options of a command line.

    `packages` and `variables` are lists for both sides: values from the first repeated name on
    belong to the second side. If no name is repeated, all values do.

    Parameters
    ----------
    words
        Two scripts or recordings; or one script and its arguments.
    packages, variables
        Package versions as `NAME==VERSION`, and environment variables as `NAME=VALUE`.
    arguments, pythons
        Arguments of the script, and interpreters, one or two of each.
    twice
        Whether the script is compared with itself.
    revision
        The Git revision of the script that is the first side.

    Raises
    ------
    ScenarioError
        If the words and options do not define two sides.
    """
    scripts = [n for n, word in enumerate(words) if word.endswith((".py", RECORDING))]
    changed = any((packages, arguments, variables, pythons, twice, revision))
    if not scripts or scripts[0]:
        raise ScenarioError(
            "diff takes two scripts or recordings, or one script and what differs: drop diff a.py "
            "b.py, or drop diff --with mujoco==3.3.7 --with mujoco==4.0.0 a.py; got {given!r}",
            given=" ".join(words),
        )
    if len(scripts) > 1 and (words[0].endswith(RECORDING) or not changed or not _is_one(words)):
        second = scripts[1]
        both = words[:second], words[second:]
    elif changed:
        both = words, words
    else:
        raise ScenarioError(
            "diff needs something to compare {script} with: another script or recording, or one of "
            "--with, --args, --env, --python, --twice, --rev",
            script=words[0],
        )
    packages_of = _divided(packages, lambda each: checked(each)[0])
    for variable in variables:
        if "=" not in variable:
            raise ScenarioError("--env must be NAME=VALUE, got {given!r}", given=variable)
    variables_of = _divided(variables, lambda each: each.partition("=")[0])
    pythons_of = _divided(pythons, lambda _: "")
    sides = []
    for n, (target, *given) in enumerate(both):
        extra = arguments[n] if len(arguments) == 2 else arguments[0] if arguments and n else None
        sides.append(
            Asked(
                target,
                [*given, *shlex.split(extra or "")],
                packages_of[n],
                dict(each.split("=", 1) for each in variables_of[n]),
                next(iter(pythons_of[n]), None),
                revision if not n else None,
                is_second=bool(n) and twice,
            )
        )
    return sides[0], sides[1]


def _is_one(words: Sequence[str]) -> bool:
    """Return whether the words after a script are arguments, not a second script."""
    return not any(Path(word).is_file() for word in words[1:] if word.endswith(".py"))


def _divided(
    values: Sequence[str], name_of: Callable[[str], str]
) -> tuple[Sequence[str], Sequence[str]]:
    """Divide an option's values between the two sides."""
    names = [name_of(each) for each in values]
    for n, name in enumerate(names):
        if name in names[:n]:
            return values[:n], values[n:]
    return [], values


@dataclass(frozen=True)
class RunSide:
    """One side of a comparison, as recorded."""

    name: str
    """Label that distinguishes this side from the other."""
    recording: Recording
    python: str
    """Python interpreter that has the engine of this side."""
    environment: Mapping[str, str]
    """Environment variables with which the interpreter finds the engine."""
    target: str = ""
    """Path of the script or recording."""
    files: Mapping[str, Sequence[tuple[str, bytes]]] = field(default_factory=dict)
    """Paths and contents of the files that the engine loaded, by the names used in calls."""


def side_of(held: Recording, name: str) -> RunSide:
    """Return a recording as a side, with an interpreter that has the engine, if there is one.

    The interpreter is the script's or drop's own, perhaps with an engine version that was
    downloaded before.
    """
    recorded = str((held.ended or {}).get("interpreter") or sys.executable)
    python = recorded if os.access(recorded, os.X_OK) else sys.executable
    version = held.seen.engine.partition(" ")[2]
    environment: dict[str, str] = {}
    if version and version_in(python) != version:
        if version_in(sys.executable) == version:
            python = sys.executable
        else:
            environment = kept(held.seen.engine, python)
    return RunSide(name, held, python, environment, str(held.path))


def recorded_side(asked: Asked, path: Path, how: verbs.DiffArguments, *, name: str) -> RunSide:
    """Record a side, or read it if it is a recording already.

    Parameters
    ----------
    asked
        The requested side.
    path
        The recording to write.
    how
        The arguments of `diff`, such as limits and progress callbacks.
    name
        The label that distinguishes this side from the other.

    Raises
    ------
    DropError
        If the side cannot be run or read.
    """
    note = how.note
    note_python = (lambda _: None) if asked.is_recording else note
    python = interpreter_of(asked.target, is_module=False, given=asked.python, note=note_python)
    environment = {**unpacked(asked.packages, python, note), **asked.variables}
    if asked.is_recording:
        held = read(Path(asked.target))
        if asked.python or environment:
            return RunSide(name, held, python, environment, asked.target)
        return replace(side_of(held, name), target=asked.target)
    digest_of_script(asked.target, is_module=False)  # before what takes long
    with exported(Path(asked.target), asked.revision) as script:
        return _recorded(replace(asked, target=str(script)), path, how, name, python, environment)


def _recorded(
    asked: Asked,
    path: Path,
    how: verbs.DiffArguments,
    name: str,
    python: str,
    environment: Mapping[str, str],
) -> RunSide:
    """Run and record a script."""
    note = how.note
    digest = digest_of_script(asked.target, is_module=False)
    steps, *_ = checked_limits(how.steps, None, None)
    program = Program(
        asked.target,
        texts_of(asked.arguments),
        python,
        steps=steps,
        perturb=OTHER_PERTURB if asked.is_second else PERTURB,
        environment=environment,
        keeps_files=True,
    )
    folders = folders_of(Path(asked.target), Reached())
    again = Again(folders=tuple(folders)) if is_offered(folders) else Again()
    from drop_physics.recording.recorder import Recorder

    recorder = Recorder({schema.ORIGIN_PROPERTY: origin_of(program, digest)}, drawn=False)
    with (
        again.ready(program) as ready,
        running.Script(ready, stdout=how.stdout, progress=how.progress) as process,
        interrupts(process.interrupt),
    ):
        ended = written(process, recorder, path, recording_id=uuid.uuid4().hex, force=True)
    for sentence in ended.notes:
        note(sentence)
    files = process.decoder.bullet.files
    return RunSide(name, read(path), python, environment, asked.target, files)

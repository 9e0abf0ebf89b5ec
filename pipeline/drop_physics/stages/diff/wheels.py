"""Downloads package versions that only one of the compared runs uses, into a cache folder.

A script imports them from there instead of its own versions (`PYTHONPATH`). No other module of drop
downloads anything.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from drop_physics.errors import DropError, ScenarioError
from drop_physics.files.outputs import output_errors
from drop_physics.messages import Message
from drop_physics.workers import users_environment

REQUIREMENT = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)==([A-Za-z0-9][A-Za-z0-9.!+_-]*)")
TAG = "import sys; print(f'{sys.implementation.cache_tag}')"
"""Program that prints the tag of an interpreter, by which wheels are chosen."""


def cache() -> Path:
    """Return the cache folder of downloaded package versions."""
    if sys.platform == "darwin":
        above = Path.home() / "Library/Caches"
    else:
        above = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return above / "drop" / "with"


def kept(engine: str, python: str) -> dict[str, str]:
    """Return the environment variables that point Python at a downloaded engine version, if any.

    `engine` is the name and version of the engine, as in a recording.
    """
    name, _, version = engine.lower().partition(" ")
    folder = cache() / f"{name}-{version}-{_tag(python)}"
    return {"PYTHONPATH": str(folder)} if folder.is_dir() else {}


def forget() -> int:
    """Empty the cache folder; return the number of deleted package versions."""
    folder = cache()
    with output_errors(folder):
        count = sum(1 for _ in folder.iterdir()) if folder.is_dir() else 0
        shutil.rmtree(folder, ignore_errors=True)
    return count


def checked(requirement: str) -> tuple[str, str]:
    """Return the name and version of a package requirement.

    Raises
    ------
    ScenarioError
        If the requirement does not have the form NAME==VERSION.
    """
    match = REQUIREMENT.fullmatch(requirement)
    if match is None:
        raise ScenarioError(
            "--with must be a package and its version, as mujoco==3.3.7, got {given!r}",
            given=requirement,
        )
    return match[1].lower().replace("_", "-"), match[2]


def unpacked(
    requirements: Sequence[str], python: str, note: Callable[[str], None]
) -> dict[str, str]:
    """Download package versions; return the environment variables that point Python at them.

    Parameters
    ----------
    requirements
        Packages and versions, such as `mujoco==3.3.7`.
    python
        The interpreter that will import the packages.
    note
        A function that is called with a sentence before each download.

    Raises
    ------
    ScenarioError
        If a requirement does not have the form NAME==VERSION.
    DropError
        If a version is not available.
    """
    if not requirements:
        return {}
    folders = [str(_folder(*checked(requirement), python, note)) for requirement in requirements]
    before = users_environment().get("PYTHONPATH")
    return {"PYTHONPATH": os.pathsep.join([*folders, *([before] if before else [])])}


def _folder(name: str, version: str, python: str, note: Callable[[str], None]) -> Path:
    folder = cache() / f"{name}-{version}-{_tag(python)}"
    if folder.is_dir():
        return folder
    note(Message("fetching {name} {version}, once", name=name, version=version))
    with output_errors(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        _install(f"{name}=={version}", part, python)
        with output_errors(folder):
            part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        if folder.is_dir():  # another process was first
            return folder
        raise
    return folder


def _tag(python: str) -> str:
    if python == sys.executable:
        return str(sys.implementation.cache_tag)
    try:
        done = subprocess.run([python, "-c", TAG], capture_output=True, text=True, check=True)
    except (OSError, ValueError, subprocess.CalledProcessError) as error:
        raise DropError(
            "{python} cannot be started: {reason}; --python takes the path of a Python interpreter",
            python=python,
            reason=getattr(error, "strerror", None) or str(error),
        ) from None
    return done.stdout.strip()


def _install(requirement: str, folder: Path, python: str) -> None:
    """Download the wheel of a package version, and unpack it into a folder."""
    where = ["--no-deps", "--target", str(folder), requirement]
    uv = shutil.which("uv")
    if uv is not None:
        command = [uv, "pip", "install", "--quiet", "--python", python, *where]
    elif find_spec("pip") is not None:
        pip = [sys.executable, "-m", "pip", "--python", python]
        command = [
            *pip,
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-compile",
            *where,
        ]
    else:
        raise DropError("--with needs uv or pip to fetch {what}; install uv", what=requirement)
    done = subprocess.run(
        command, capture_output=True, text=True, env=users_environment(), check=False
    )
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.strip()]
        why = next((line for line in reversed(said) if "error" in line.lower()), "")
        raise DropError(
            "{what} cannot be fetched: {why}; see what there is with: pip index versions {name}",
            what=requirement,
            why=why
            or (said[-1] if said else Message("it ended with {code}", code=done.returncode)),
            name=requirement.partition("==")[0],
        )

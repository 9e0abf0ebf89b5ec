"""Where outputs may go: checked before any work is done for them.

An output is not an input, is not written through a link, and replaces only what it may. Nor does
the name that it has until it is whole: what is there already stays, and the next one is taken.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shlex
import shutil
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.filesize import decimal

from pipeline.errors import OutputError

MOST_PARTS = 9
"""Names that an unfinished file may have: what killed runs leave does not grow for ever."""


def part_of(path: Path) -> Path:
    """Return the name a file has until it is whole."""
    return path.with_name(path.name + ".part")


def free_part_of(path: Path) -> Path:
    """Return the first of `.part`, `.2.part` and so on at which nothing is.

    Raises
    ------
    OutputError
        If there are `MOST_PARTS` already.
    """
    others = (path.with_name(f"{path.name}.{number}.part") for number in range(2, MOST_PARTS + 1))
    for part in (part_of(path), *others):
        if not any(map(os.path.lexists, (part, sealed_of(part)))):
            return part
    raise OutputError(
        f"{part_of(path)} and {MOST_PARTS - 1} more unfinished files beside it are left as they "
        "are; remove those that nobody needs"
    )


def sealed_of(part: Path) -> Path:
    """Return the name of the copy of a finished `.part` file that the viewer's layout goes into."""
    return part.with_name(part.name + ".sealed")


def is_part(path: Path) -> bool:
    """Whether a name is that of a file which may not be whole."""
    return path.name.endswith(".part")


def check_target(path: Path, *, force: bool) -> None:
    """Make sure a file can be written, before any work is done for it.

    Raises
    ------
    OutputError
        If it exists and `force` is not given, is not a regular file, or its folder is missing or
        read-only.
    """
    folder = path.parent
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise OutputError(f"{str(path)!r} must be UTF-8: Rerun takes no other names") from None
    with translated(path):
        if path.is_dir():
            raise OutputError(f"{path} is a folder; name a file in it, such as {path / 'run.rrd'}")
        if path.exists() and not path.is_file():  # a rename would put a file in a device's place
            raise OutputError(f"{path} is not a regular file; give another name")
        if os.path.lexists(path) and not force:  # a link that leads nowhere exists, too
            raise OutputError(f"{path} exists and is left as it is; give another name, or --force")
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file, not a folder; give another name")
        _check_home(folder)
        if not folder.is_dir():
            raise OutputError(
                f"the folder {folder} does not exist; make it with: "
                f"{shlex.join(['mkdir', '-p', str(folder)])}"
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"the folder {folder} cannot be written to; choose another one")
        check_regular(part_of(path))


def check_apart(outputs: Sequence[Path], *, inputs: Sequence[Path]) -> None:
    """Make sure that no output is an input or another output, by whatever name or link.

    Raises
    ------
    OutputError
        If writing one would replace what the same command reads or writes.
    """
    taken = [(path, "reads") for path in inputs]
    for output in outputs:
        part = part_of(output)
        names = (output, part, sealed_of(part))  # all that it has until it is whole
        for other, does in taken:
            if any(_is_same(name, other) for name in names):
                raise OutputError(
                    f"writing {output} would replace {other}, which the same command {does}; "
                    "give another name"
                )
        taken += [(name, "writes") for name in names]


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:  # one of them does not exist
        return os.path.realpath(one) == os.path.realpath(other)


HEAD_BYTES = 4096
"""Where a picture of ours says that it is one."""


def check_kind(path: Path, beginning: bytes, mark: bytes) -> None:
    """Make sure that an output nobody named replaces only a file of ours, with our mark in it.

    Raises
    ------
    OutputError
        If something else has its name.
    """
    with translated(path), contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        if not head.startswith(beginning) or mark not in head:
            raise refused(path)


def refused(path: Path) -> OutputError:
    """Return the error for a file that has an output's default name and is something else."""
    return OutputError(
        f"{path} is not what drop writes under that name, and is left as it is; rename it, give "
        "the output another name, or --force"
    )


@contextlib.contextmanager
def reserved(folder: Path, stem: str, *, also: Sequence[str] = ()) -> Iterator[Path]:
    """Yield the first of STEM.rrd, STEM-2.rrd, … of which nothing is there yet, for us alone.

    Its empty `.part` file, which only one process can make, keeps others away from it. `also` says
    how the files end that will be put beside it.

    Raises
    ------
    OutputError
        If the folder cannot be written to.
    """
    for number in itertools.count(1):
        name = stem if number == 1 else f"{stem}-{number}"
        path = folder / f"{name}.rrd"
        part, made = part_of(path), (path, *(folder / f"{name}{end}" for end in also))
        if any(map(os.path.lexists, (part, sealed_of(part), *made))):
            continue
        with translated(path), contextlib.suppress(FileExistsError):
            part.touch(exist_ok=False)
            if not any(map(os.path.lexists, made)):
                break
            part.unlink()  # another process has finished that number just now
    try:
        yield path
    except BaseException:
        with contextlib.suppress(OSError):  # it has its final name, or its folder is gone
            if not part.stat().st_size:
                part.unlink()
        raise


def make_folder(path: Path, option: str) -> None:
    """Make a folder for outputs where it is missing, and those above it.

    Raises
    ------
    OutputError
        If it cannot be made; the message names the option it was given with.
    """
    _check_home(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, UnicodeEncodeError) as error:
        reason = getattr(error, "strerror", None) or "its name is not UTF-8"
        raise OutputError(
            f"the folder {path!s} cannot be made: {reason}; choose another with {option}"
        ) from None


def _check_home(folder: Path) -> None:
    """Make sure that no folder called `~` comes about: shells leave the one in `--out=~/x` alone.

    Raises
    ------
    OutputError
        If the folder lies in somebody's home, and in no folder here that is called so.
    """
    home = os.path.expanduser(folder)  # noqa: PTH111 - unlike pathlib's it never fails
    if home != str(folder) and not Path(folder.parts[0]).exists():
        raise OutputError(f"the shell did not expand the ~ in {folder}; write {home} instead")


def check_regular(path: Path) -> None:
    """Make sure that a file of ours would not be written through a link, or into a pipe.

    Raises
    ------
    OutputError
        If something else has its name.
    """
    if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
        raise OutputError(f"{path} is not a regular file, and in the way; remove it")


def check_room(path: Path, needed_bytes: int) -> None:
    """Make sure that a file has room on its disk, before any work is done for it.

    Raises
    ------
    OutputError
        If it has not.
    """
    free = shutil.disk_usage(path.parent).free
    if needed_bytes > free:
        raise OutputError(
            f"{path} needs some {decimal(needed_bytes)} on the disk while it is written, and "
            f"{decimal(free)} are free; make room, or record less"
        )


def written(error: OSError) -> str | None:
    """Return the file that could not be written: of a copy or a rename the second, if any."""
    name: str | None = error.filename2 or error.filename
    return name


@contextlib.contextmanager
def translated(path: Path) -> Iterator[None]:
    """Turn what the system and Rerun say of a failed write into one line of ours."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{written(error) or path} cannot be written: {reason}") from error
    except RuntimeError as error:  # Rerun's writer, and its command line
        found = re.search(r"([\w ]+) \(os error \d+\)", str(error))
        if found is None:
            raise
        reason = found[1].strip()
        what = f"{path} cannot be written: {reason}"
        raise OutputError(f"{what}; make room there, or choose another folder") from error

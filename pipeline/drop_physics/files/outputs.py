"""Choose output paths, and check them before any work is done.

An output is never an input, is never written through a link, and replaces only files that may be
replaced. The temporary name follows the same rules: an existing file of that name is kept, and the
next free name is used.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.filesize import decimal

from drop_physics.errors import OutputError, check_suffix
from drop_physics.messages import Message

MOST_PARTS = 9
"""Largest number of unfinished files with the same name, which limits what killed runs leave
behind."""


def part_of(path: Path) -> Path:
    """Return the name of a file while it is being written."""
    return path.with_name(path.name + ".part")


def free_part_of(path: Path) -> Path:
    """Return the first unused name of `.part`, `.2.part` and so on.

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
        "{part} and {others} more unfinished files beside it are kept; remove those that nobody "
        "needs",
        part=part_of(path),
        others=MOST_PARTS - 1,
    )


def sealed_of(part: Path) -> Path:
    """Return the path of a finished `.part` file's copy, to which the layout is added."""
    return part.with_name(part.name + ".sealed")


def is_part(path: Path) -> bool:
    """Return whether a file name is that of an unfinished file."""
    return path.name.endswith(".part")


def check_target(path: Path, *, force: bool) -> None:
    """Check that a file can be written, before any work is done for it; create its folder.

    Raises
    ------
    OutputError
        If the file exists and `force` is not given, if it is not a regular file, or if its folder
        cannot be created or written to.
    """
    folder = path.parent
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise OutputError(
            "{path!r} must be UTF-8: Rerun accepts no other names", path=str(path)
        ) from None
    with output_errors(path):
        if path.is_dir():
            raise OutputError(
                "{path} is a folder; name a file in it, such as {file}",
                path=path,
                file=path / "run.rrd",
            )
        if path.exists() and not path.is_file():  # a rename would replace a device
            raise OutputError("{path} is not a regular file; give another name", path=path)
        if os.path.lexists(path) and not force:  # dangling links count as existing
            raise OutputError(
                "{path} exists and is left as it is; give another name, or --force", path=path
            )
        if folder.exists() and not folder.is_dir():
            raise OutputError("{folder} is a file, not a folder; give another name", folder=folder)
        make_folder(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(
                "the folder {folder} cannot be written to; choose another one", folder=folder
            )
        check_regular(part_of(path))


def check_table(path: Path, *, force: bool) -> None:
    """Check that a table can be written, before any work is done for it.

    Raises
    ------
    ScenarioError
        If the suffix is neither .parquet nor .csv.
    OutputError
        If the file exists and `force` is not given, or cannot be written.
    """
    check_suffix("--table", path, (".parquet", ".csv"))
    check_target(path, force=force)


def check_apart(outputs: Sequence[Path], *, inputs: Sequence[Path]) -> None:
    """Check that no output is an input or another output, under any name or link.

    Raises
    ------
    OutputError
        If writing an output would replace a file that the same command reads or writes.
    """
    written: list[Path] = []
    for output in outputs:
        part = part_of(output)
        names = (output, part, sealed_of(part))  # all the names it has while it is written
        for other in (*inputs, *written):
            if not any(_is_same(name, other) for name in names):
                continue
            if other in written:
                raise OutputError(
                    "writing {output} would replace {other}, which the same command writes; give "
                    "another name",
                    output=output,
                    other=other,
                )
            raise OutputError(
                "writing {output} would replace {other}, which the same command reads; give "
                "another name",
                output=output,
                other=other,
            )
        written += names


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except OSError:  # one of them does not exist
        return os.path.realpath(path) == os.path.realpath(other)


HEAD_BYTES = 4096
"""Number of bytes at the start of an image in which drop's mark is searched."""


def check_kind(path: Path, beginning: bytes, mark: bytes) -> None:
    """Check that an output with a default name replaces only a file that has drop's mark.

    Raises
    ------
    OutputError
        If another file has the output's name.
    """
    with output_errors(path), contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        if not head.startswith(beginning) or mark not in head:
            raise refused(path)


def refused(path: Path) -> OutputError:
    """Return the error for a file with an output's default name that `drop` did not write."""
    return OutputError(
        "{path} is not what drop writes under that name, and is left as it is; rename it, give "
        "the output another name, or --force",
        path=path,
    )


def numbered(folder: Path, stem: str) -> Iterator[Path]:
    """Yield STEM.rrd, STEM-2.rrd, … endlessly."""
    yield folder / f"{stem}.rrd"
    for number in itertools.count(2):
        yield folder / f"{stem}-{number}.rrd"


@contextlib.contextmanager
def reserved(folder: Path, stem: str, *, also: Sequence[str] = ()) -> Iterator[Path]:
    """Yield the first unused name of STEM.rrd, STEM-2.rrd, …, reserved for this process.

    An empty `.part` file, which only one process can create, reserves the name. `also` are the
    endings of further files that will be written with the same stem.

    Raises
    ------
    OutputError
        If the folder cannot be written to.
    """
    for path in numbered(folder, stem):
        part, outputs = part_of(path), (path, *(folder / f"{path.stem}{end}" for end in also))
        if any(map(os.path.lexists, (part, sealed_of(part), *outputs))):
            continue
        with output_errors(path), contextlib.suppress(FileExistsError):
            part.touch(exist_ok=False)
            if not any(map(os.path.lexists, outputs)):
                break
            part.unlink()  # another process has just finished that number
    try:
        yield path
    except BaseException:
        with contextlib.suppress(OSError):  # it has its final name, or its folder is gone
            if not part.stat().st_size:
                part.unlink()
        raise


def make_folder(path: Path) -> None:
    """Create a folder for outputs with its parents, if missing.

    Raises
    ------
    OutputError
        If the folder cannot be created.
    """
    _check_home(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, UnicodeEncodeError) as error:
        reason = getattr(error, "strerror", None) or Message("its name is not UTF-8")
        raise OutputError(
            "the folder {path} cannot be created: {reason}; choose another",
            path=path,
            reason=reason,
        ) from None


def _check_home(folder: Path) -> None:
    """Refuse to create a folder called `~`, since shells do not expand it in `--out=~/x`.

    Raises
    ------
    OutputError
        If the folder would be in a home directory, and no folder of that name exists.
    """
    home = os.path.expanduser(folder)  # noqa: PTH111 - unlike pathlib's, it never fails
    if home != str(folder) and not Path(folder.parts[0]).exists():
        raise OutputError(
            "the shell did not expand the ~ in {folder}; write {home} instead",
            folder=folder,
            home=home,
        )


def check_regular(path: Path) -> None:
    """Check that a file would not be written through a link, or into a pipe.

    Raises
    ------
    OutputError
        If the name belongs to anything other than a regular file.
    """
    if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
        raise OutputError("{path} is in the way and is not a regular file; remove it", path=path)


def check_room(path: Path, needed_bytes: int) -> None:
    """Check that the disk has room for a file, before any work is done for it.

    Raises
    ------
    OutputError
        If the disk has too little free space.
    """
    free = shutil.disk_usage(path.parent).free
    if needed_bytes > free:
        raise OutputError(
            "{path} needs about {needed} on the disk while it is written, and {free} are free; "
            "make room, or record less",
            path=path,
            needed=decimal(needed_bytes),
            free=decimal(free),
        )


def written(error: OSError) -> str | None:
    """Return the file that could not be written: for a copy or a rename, the target."""
    name: str | None = error.filename2 or error.filename
    return name


def unwritable(path: Path | str, reason: str) -> OutputError:
    """Return the error for a file that cannot be written, with the system's reason."""
    return OutputError(
        "{path} cannot be written: {reason}; make room there, or choose another folder",
        path=path,
        reason=reason,
    )


@contextlib.contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """Convert write errors of the system and of Rerun to drop's one-line error."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise unwritable(written(error) or path, reason) from error
    except RuntimeError as error:  # Rerun's writer, and its command line
        match = re.search(r"([\w ]+) \(os error \d+\)", str(error))
        if match is None:
            raise
        raise unwritable(path, match[1].strip()) from error

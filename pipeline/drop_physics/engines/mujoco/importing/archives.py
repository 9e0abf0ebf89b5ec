"""Reads the arrays of npz and hdf5 files that other programs saved.

An hdf5 file has the layout of robomimic and LIBERO: demonstrations at `data/demo_N`, each with
`states` and, as an attribute, `model_file`.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.errors import DropError, ScenarioError

if TYPE_CHECKING:
    import h5py

NPZ, HDF5 = (".npz",), (".hdf5", ".h5")
DEMONSTRATIONS = "data"
DIGITS = re.compile(r"\d+")


@dataclass(frozen=True, eq=False)
class Archive:
    """The arrays of an npz or hdf5 file."""

    path: Path
    arrays: dict[str, NDArray[Any]]
    """Numeric arrays, by key; for a demonstration, by key within its group."""
    objects: tuple[str, ...] = ()
    """Keys of entries that are not numeric arrays, and are not read."""
    demonstrations: tuple[str, ...] = ()
    """Names of the demonstrations in an hdf5 file."""
    model: str | None = field(default=None, repr=False)
    """The model's XML, if the file contains it."""


def archive_of(path: Path, world: int | None) -> Archive:
    """Return the arrays of a file; of several demonstrations, the given or the first.

    Raises
    ------
    ScenarioError
        If there is no such file or demonstration, or it is of another kind.
    DropError
        If it is damaged, or h5py is not installed.
    """
    if path.suffix not in (*NPZ, *HDF5):
        raise ScenarioError(
            "FILE must end in .npz, .hdf5 or .h5, got {path!r}; other data can be saved with: "
            "numpy.savez(FILE, qpos=…, qvel=…, ctrl=…)",
            path=str(path),
        )
    if not path.is_file():
        raise ScenarioError("FILE must be a file, got {path!r}: there is none", path=str(path))
    try:
        return _npz(path) if path.suffix in NPZ else _hdf5(path, world)
    except DropError:
        raise
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, KeyError, ValueError) as error:
        raise DropError(
            "{path} cannot be read as {kind}: {reason}; save it again",
            path=str(path),
            kind=path.suffix.removeprefix("."),
            reason=" ".join(str(error).split()) or type(error).__name__,
        ) from None


def _npz(path: Path) -> Archive:
    arrays, objects = {}, []
    with path.open("rb") as file:
        held = np.load(file, allow_pickle=False)
        if not isinstance(held, np.lib.npyio.NpzFile):
            raise ValueError("it is one array, not an archive of named ones")
        for name in held.files:
            try:
                array = held[name]
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                objects.append(name)
            else:
                if isinstance(array, np.ndarray) and array.dtype.kind in "fiub":  # not bytes
                    arrays[name] = array
                else:
                    objects.append(name)
    return Archive(path, arrays, tuple(objects))


def _hdf5(path: Path, world: int | None) -> Archive:
    try:
        import h5py
    except ImportError:
        raise DropError(
            "{path} takes the package h5py; try: pip install h5py",
            path=str(path),
        ) from None
    with h5py.File(path, "r") as file:
        data = file.get(DEMONSTRATIONS)
        names = sorted(data, key=_number) if isinstance(data, h5py.Group) else []
        names = [name for name in names if isinstance(data[name], h5py.Group)]
        if not names:
            raise ValueError(f"it has no {DEMONSTRATIONS}/demo_N")
        if world is not None and not 0 <= world < len(names):
            raise ScenarioError(
                "--world must be between 0 and {last}, got {world}: {path} has {names}",
                last=len(names) - 1,
                world=world,
                path=str(path),
                names=", ".join(names[:4]) + (", …" if names[4:] else ""),
            )
        group = data[names[world or 0]]
        arrays, objects = {}, []
        for name, item in _datasets(group):
            if item.dtype.kind in "fiub":
                if item.ndim <= 2:  # pictures are left where they are
                    arrays[name] = item[()]
            else:
                objects.append(name)
        model = group.attrs.get("model_file", data.attrs.get("model_file"))
        text = model.decode() if isinstance(model, bytes) else model
        return Archive(path, arrays, tuple(objects), tuple(names), text)


def _datasets(group: h5py.Group) -> Iterator[tuple[str, h5py.Dataset]]:
    import h5py

    found: dict[str, h5py.Dataset] = {}
    group.visititems(lambda name, item: found.__setitem__(name, item))
    for name, item in found.items():
        if isinstance(item, h5py.Dataset):
            yield name, item


def _number(name: str) -> tuple[int, str]:
    found = DIGITS.search(name)
    return int(found[0]) if found else 0, name

"""Copies of MuJoCo's forces and matrices, made at each evaluation of a replayed step."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..memory import view_of

BATCH_BYTES = 6 << 20
"""Approximate number of bytes that are copied before they are explained."""
FEWEST, MOST = 8, 512
"""Smallest and largest number of steps in a batch."""
NEAR = 512
"""Arrays separated by gaps of at most this many bytes are copied together."""
FORCES = (
    *("qfrc_bias", "qfrc_spring", "qfrc_damper", "qfrc_gravcomp", "qfrc_fluid", "qfrc_adhesion"),
    *("qfrc_passive", "actuator_force", "qfrc_actuator", "qfrc_smooth", "qfrc_constraint", "qacc"),
)
POSITIONS = ("subtree_com", "cdof")
MOMENTS = ("actuator_moment", "moment_rownnz", "moment_rowadr", "moment_colind")
TENDONS = ("ten_length", "ten_velocity", "ten_J")
OF_TENDONS = ("ten_J_rownnz", "ten_J_rowadr", "ten_J_colind")
CONTACT = ("dist", "pos", "frame", "friction", "dim", "geom", "efc_address")
"""Fields of a contact that are read."""


class MemorySpan:
    """Arrays of an MjData that are close in memory and are copied together.

    Parameters
    ----------
    arrays
        Pairs of a name and an array, in the order of memory.
    """

    def __init__(self, arrays: list[tuple[str, Any]]) -> None:
        begin = arrays[0][1].ctypes.data
        last = arrays[-1][1]
        size = last.ctypes.data + last.nbytes - begin
        self.view = np.frombuffer(view_of(begin, size), np.uint8)
        self.parts = [
            (name, array.ctypes.data - begin, array.nbytes, array.dtype) for name, array in arrays
        ]


def spans_of(arrays: dict[str, Any]) -> list[MemorySpan]:
    """Return the memory spans that cover all non-empty arrays."""
    held = sorted(
        ((name, array) for name, array in arrays.items() if array.nbytes),
        key=lambda item: item[1].ctypes.data,
    )
    groups: list[list[tuple[str, Any]]] = []
    for name, array in held:
        if groups:
            last = groups[-1][-1][1]
            if array.ctypes.data - last.ctypes.data - last.nbytes <= NEAR:
                groups[-1].append((name, array))
                continue
        groups.append([(name, array)])
    return [MemorySpan(group) for group in groups]


class Contacts:
    """Reads contacts from MuJoCo's memory, where they start the MjData's arena."""

    def __init__(self) -> None:
        self.size = 0
        """Size of a contact in memory [bytes]."""
        self.dtype: Any = None
        self._at = 0

    def copy(self, d: Any, count: int) -> bytes:
        """Copy the first `count` contacts as bytes."""
        if not self.size:
            self._learn(d)
        return view_of(self._at, count * self.size).tobytes()

    def check(self, d: Any) -> None:
        """Raise LookupError if an MjData's contacts do not lie at the start of its arena."""
        if self.size and d.ncon and d.contact.dist.ctypes.data != self._at:
            raise LookupError("contacts are not at the start of the arena")

    def _learn(self, d: Any) -> None:
        arrays = {name: getattr(d.contact, name) for name in CONTACT}
        self._at = arrays["dist"].ctypes.data
        self.size = arrays["dist"].strides[0]
        self.dtype = np.dtype(
            {
                "names": list(arrays),
                "formats": [(a.dtype, a.shape[1:]) for a in arrays.values()],
                "offsets": [a.ctypes.data - self._at for a in arrays.values()],
                "itemsize": self.size,
            }
        )


class Copies:
    """Copies of MuJoCo's results, one for each evaluation, in order.

    Parameters
    ----------
    m, d
        The MjModel, and the MjData in which it is evaluated.
    mass_name
        The field of the MjData with the mass matrix: `M` or, in old versions, `qM`.
    implicit
        Whether the derivatives of forces are copied, too.
    """

    def __init__(self, m: Any, d: Any, mass_name: str, *, implicit: bool) -> None:
        self._d = d
        names = [*FORCES, *POSITIONS, mass_name]
        if m.nu:
            names += MOMENTS
        if implicit:
            names.append("qDeriv")
        self.tendons = bool(m.ntendon)
        if self.tendons:
            names += TENDONS
            names += OF_TENDONS
        self.spans = spans = spans_of({n: getattr(d, n) for n in names if hasattr(d, n)})
        size = sum(len(span.view) for span in spans) + 64 * m.nv
        self.room = int(np.clip(BATCH_BYTES // max(size, 1), FEWEST, MOST))
        self._rows = [np.empty((self.room, len(span.view)), np.uint8) for span in spans]
        self._pairs = [(rows, span.view) for rows, span in zip(self._rows, spans)]
        self.contacts = Contacts()
        self.begin()

    def begin(self) -> None:
        """Discard all copies."""
        self.count = self.bytes = 0
        self.nefc: list[int] = []
        self.ncon: list[int] = []
        self.rows: dict[str, list[bytes]] = {
            name: []
            for name in (
                *("efc_J", "efc_force", "efc_type", "efc_id", "contact"),
                *("efc_J_rownnz", "efc_J_rowadr", "efc_J_colind"),
            )
        }

    @property
    def is_full(self) -> bool:
        """Return whether the buffer is full."""
        return self.count >= self.room or self.bytes > BATCH_BYTES

    def copy(self, sparse: bool) -> None:
        """Copy MuJoCo's current results; `sparse` says whether its Jacobian is sparse."""
        d, at = self._d, self.count
        for rows, view in self._pairs:
            rows[at] = view
        self.count = at + 1
        nefc = d.nefc
        self.nefc.append(nefc)
        if not nefc:
            self.ncon.append(0)
            return
        held = self.rows
        jacobian = d.efc_J.tobytes()
        held["efc_J"].append(jacobian)
        held["efc_force"].append(d.efc_force.tobytes())
        held["efc_type"].append(d.efc_type.tobytes())
        held["efc_id"].append(d.efc_id.tobytes())
        if sparse:
            for name in ("efc_J_rownnz", "efc_J_rowadr", "efc_J_colind"):
                held[name].append(getattr(d, name).tobytes())
        ncon = d.ncon
        self.ncon.append(ncon)
        if ncon:
            held["contact"].append(self.contacts.copy(d, ncon))
        self.bytes += len(jacobian) + 32 * nefc + ncon * self.contacts.size

    def named(self) -> dict[str, Any]:
        """Return the copied arrays by name, shape (count, elements)."""
        found = {}
        for span, rows in zip(self.spans, self._rows):
            for name, begin, size, dtype in span.parts:
                part = np.ascontiguousarray(rows[: self.count, begin : begin + size])
                found[name] = part.view(dtype)
        return found

    def columns(self, name: str, dtype: Any) -> Any:
        """Return the values that an array had in all evaluations, concatenated."""
        return np.frombuffer(b"".join(self.rows[name]), dtype)

"""The script's clock: simulated time, or the total time slept if that is more.

`sleep` returns at once, and the clock then shows the time after the sleep. A script that alternates
steps and sleeps keeps its pace. Every run of the script reads the same times.

Reading the clock advances it, but does not count as waiting: a compiler reads the clock a million
times.

The standard library, and threads other than the main one, keep the real clock, since they wait for
real events.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from sys import _getframe
from threading import get_ident
from typing import Any

from .hidden import hide
from .sites import LIBRARY

CALL_S = 1e-4
"""Virtual duration of an engine call while a simulation runs in real time [s]."""
READ_S = 1e-6
"""Virtual duration of reading the clock [s]."""
ASK_S, LONGEST_ASK_S = 1e-6, 1e-3
"""Virtual duration of polling for input [s], at first and at most: it grows until a step is made.
"""
NAMES = ("time", "monotonic", "perf_counter")

_OTHERS = LIBRARY + "site-packages" + os.sep


class Clock:
    """The script's clock: virtual, or the real one if `real`.

    The virtual clock starts at `begins_s` [s], or at the current time.
    """

    def __init__(self, *, real: bool, begins_s: float | None = None) -> None:
        self.real, self._begins_s = real, begins_s
        self.timing: Callable[[Any], None] | None = None
        """Function that is called with the frame that first reads the time after a step."""
        self.simulated_s = 0.0
        self.waited_s = 0.0
        self.idle_s = 0.0
        """Time slept, or spent asking for input, since the last step [s]."""
        self.passed: Callable[[], None] = lambda: None
        """Function that is called when time has passed."""
        self._asks = 0
        self._began = time.monotonic()
        self._theirs: dict[str, Any] = {}
        self._library: dict[str, bool] = {}

    def now_s(self) -> float:
        """Return the time since the script started [s]."""
        if self.real:
            return _real_monotonic() - self._began
        return max(self.simulated_s, self.waited_s)

    def step(self, simulated_s: float) -> None:
        """Set the total simulated time [s]."""
        if simulated_s > self.simulated_s:
            self.simulated_s = simulated_s
        self.idle_s, self._asks = 0.0, 0

    def wait(self, seconds: float) -> None:
        """Advance the clock by a sleep, which returns at once."""
        if self.real:
            self.passed()
            return
        self.waited_s += seconds
        self.idle_s += seconds
        self.passed()

    def ask(self) -> None:
        """Advance the clock a little because the script polls for input."""
        self.wait(self._asking_s())

    def read(self) -> None:
        """Advance the clock a little when the script reads it; if `real`, follow the real clock."""
        lag_s = self.simulated_s - self.waited_s
        self.waited_s += max(READ_S, min(self._asking_s(), lag_s))
        self.passed()

    def _asking_s(self) -> float:
        self._asks += 1
        return min(ASK_S * self._asks, LONGEST_ASK_S)

    def install(self) -> None:
        """Replace the clock functions in the module `time`."""
        if self.real:
            return
        self._theirs = {name: getattr(time, name) for name in (*NAMES, "sleep")}
        self._theirs |= {f"{name}_ns": getattr(time, f"{name}_ns") for name in NAMES}
        for name in NAMES:
            began = self._theirs[name]() if self._begins_s is None else self._begins_s
            setattr(time, name, self._reading(self._theirs[name], began, 1.0))
            setattr(time, f"{name}_ns", self._reading(self._theirs[f"{name}_ns"], began, 1e9))
        time.sleep = self._sleeping(self._theirs["sleep"])

    def remove(self) -> None:
        """Restore the original functions of the `time` module."""
        for name, function in self._theirs.items():
            setattr(time, name, function)
        self._theirs = {}

    def _reading(self, real: Any, began: float, unit: float) -> Any:
        def read() -> Any:
            try:
                if self._is_real():
                    return real()
                if self.timing is not None and self.simulated_s:
                    self.timing(_getframe(1))
                    self.timing = None
                self.read()
                now = began + self.now_s()
                return now if unit == 1.0 else int(now * unit)
            except BaseException as error:
                hide(error)
                raise

        read.__name__ = real.__name__
        return read

    def _sleeping(self, real: Any) -> Any:
        def sleep(seconds: float) -> None:
            try:
                # An argument that is not a time gets Python's own error.
                if self._is_real() or not hasattr(seconds, "__float__") or not seconds >= 0:
                    real(seconds)
                    return
                self._asks = 0
                self.wait(float(seconds))
            except BaseException as error:
                hide(error)
                raise

        return sleep

    def _is_real(self) -> bool:
        """Return whether the caller should read the real clock, since it is not the script."""
        if not self._theirs or get_ident() != _MAIN:
            return True
        name = _getframe(2).f_code.co_filename
        known = self._library.get(name)
        if known is None:
            known = name.startswith("<frozen") or (
                name.startswith(LIBRARY) and not name.startswith(_OTHERS)
            )
            self._library[name] = known
        return known


_MAIN = threading.main_thread().ident
_real_monotonic = time.monotonic

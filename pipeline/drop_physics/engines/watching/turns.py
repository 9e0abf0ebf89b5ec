"""A lock for sending to the recorder: one thread at a time, not interrupted by signals."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Any

from .hidden import hiding


class Turn:
    """A lock that also delays signals until it is released.

    A signal handler of the script, or Python's own for Ctrl-C, may raise an exception wherever it
    is called. Within drop's code this would leave a message half sent, so handlers are called when
    the lock is released.

    Code that runs at every call uses `acquire` and `release` directly, then `give_back` if `kept`
    is not empty.
    """

    def __init__(self) -> None:
        lock: Any = threading.RLock()
        self.acquire: Callable[[], Any] = lock.acquire
        self.release: Callable[[], None] = lock.release
        self.kept: list[Callable[[], Any]] = []
        """Signal handlers to call when the lock is released."""
        self._is_owned = lock._is_owned
        self._handlers: dict[int, Any] = {}
        self._signal, self._getsignal = signal.signal, signal.getsignal

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()
        if self.kept:
            self.give_back()

    def give_back(self) -> None:
        """Run the delayed signal handlers, unless an outer lock is still held."""
        while self.kept and not self._is_owned():
            self.kept.pop(0)()

    def install(self) -> None:
        """Delay the signals of existing handlers, and of those that a script will install."""
        if threading.current_thread() is not threading.main_thread():
            return
        signal.signal, signal.getsignal = self._set, self._get
        if self._getsignal(signal.SIGINT) is signal.default_int_handler:
            self._set(signal.SIGINT, signal.default_int_handler)

    def remove(self) -> None:
        """Restore the original signal handlers and functions."""
        if signal.signal == self._set:
            signal.signal, signal.getsignal = self._signal, self._getsignal
            for number, handler in self._handlers.items():
                self._signal(number, handler)
            self._handlers = {}

    @hiding
    def _set(self, signalnum: Any, handler: Any) -> Any:
        def keep(number: int, frame: Any) -> None:
            if self._is_owned():
                self.kept.append(lambda: handler(number, frame))
            else:
                handler(number, frame)

        is_ours = callable(handler) and not isinstance(handler, signal.Handlers)
        before = self._signal(signalnum, hiding(keep) if is_ours else handler)
        before = self._handlers.pop(int(signalnum), before)
        if is_ours:
            self._handlers[int(signalnum)] = handler
        return before

    @hiding
    def _get(self, signalnum: Any) -> Any:
        current = self._getsignal(signalnum)
        return self._handlers.get(int(signalnum), current)

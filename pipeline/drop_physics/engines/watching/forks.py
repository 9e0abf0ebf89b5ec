"""Forks trial runs from a run that pauses before an engine call.

A fork inherits the memory of the interpreter, imports, generators and clock, so that nothing has to
be repeated. The recorder requests a trial through a socket, and sends a pipe and a block of memory
for the trial's stream; it already has the stream of the steps before the fork. A trial shares no
file with the run: its writes go to a separate layer (`private`), and its files are opened again
(`descriptors`).
"""

from __future__ import annotations

import _socket
import atexit
import contextlib
import gc
import json
import os
import random
import select
import struct
from array import array
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from . import descriptors, edits, limits

if TYPE_CHECKING:
    from .host import ScriptWatch

FIRST_USE, FIRST_LINE = -1, -2
"""Points at which a run pauses, other than after a number of steps: before the first use of the
engine, or after the script's imports."""
LENGTH = struct.Struct("<I")
"""Header of a request: the length of its JSON. Two or three file descriptors are sent with it."""
LOOKS_EVERY_S = 0.02
"""Interval at which the paused run checks for ended trials [s]."""


class Forks:
    """The forking of trial runs from this run.

    Parameters
    ----------
    watch
        The watch of the run.
    asks
        The descriptor of the socket through which the recorder requests trials.
    at
        The number of steps after which the run pauses, or `FIRST_USE` or `FIRST_LINE`.
    """

    def __init__(self, watch: ScriptWatch, asks: int, at: int) -> None:
        self._watch, self._socket, self._at = watch, _socket.socket(fileno=asks), at
        os.set_inheritable(asks, False)
        self._children: dict[int, int] = {}
        """Numbers of trials, by process id."""
        self._is_trial = self._is_flushed = False
        self._prevented = ""
        """The resources that trials would share with the paused run, so that none can be forked."""

    def stop(self, *, steps: bool) -> bool:
        """Pause if this engine call is the one to pause at; return True in a trial that continues.

        Parameters
        ----------
        steps
            Whether the call makes a step.
        """
        later = self._at != FIRST_USE and not (steps and self._watch.steps_made >= self._at)
        if self._is_trial or later or self.at_first_line:
            return False
        return self._stop()

    @property
    def at_first_line(self) -> bool:
        """True if the run pauses after the script's imports."""
        return self._at == FIRST_LINE

    def stop_at_first_line(self) -> None:
        """Pause after the script's imports; only trials continue from there."""
        self._stop()

    def _stop(self) -> bool:
        # The script writes, opens and starts nothing as long as it pauses.
        self._is_flushed, self._prevented = False, self._shared()
        self._tell("serving", shared=self._prevented)
        while True:
            request, *files = self._next()
            if "at" in request:
                self._at = request["at"]
                return False
            if self._forked(request, *files):
                return True

    def end(self) -> None:
        """End a trial process at once, without Python's slow cleanup."""
        if self._is_trial:
            atexit._run_exitfuncs()
            os._exit(0)

    def _next(self) -> list[Any]:
        """Return the next request with its descriptors; end the process if there is none."""
        while not select.select([self._socket], [], [], LOOKS_EVERY_S if self._children else None)[
            0
        ]:
            self._reap()
        head, sent, _, _ = self._socket.recvmsg(LENGTH.size, _socket.CMSG_SPACE(3 * 4))
        if not head:
            os._exit(0)
        text = b""
        while len(text) < LENGTH.unpack(head)[0]:
            text += self._socket.recv(LENGTH.unpack(head)[0] - len(text))
        files = array("i")
        for _, _, data in sent:
            files.frombytes(data)
        return [json.loads(text), *files]

    def _reap(self) -> None:
        """Report the exit statuses of ended trials."""
        for process in [*self._children]:
            ended, status, used = os.wait4(process, os.WNOHANG)
            if ended:
                number = self._children.pop(process)
                took_s = used.ru_utime + used.ru_stime
                self._tell("ended", trial=number, status=status, processor_s=took_s)

    def _tell(self, what: str, **values: Any) -> None:
        with self._watch.lock:
            self._watch.pipe.note(what, **values)
            self._watch.pipe.flush()

    def _forked(self, trial: dict[str, Any], pipe: int, block: int, printed: int) -> bool:
        """Fork a trial from the paused run; return whether this process is the trial."""
        watch, files = self._watch, (pipe, block, printed)
        begun, child = b"", -1
        if not self._prevented and watch.can_become(trial):
            self._flush()
            with watch.lock:
                watch.pipe.flush()
            drawn = random.getstate()  # which Python seeds anew after a fork
            watch.is_parting = True
            gc.freeze()  # collecting would copy what is shared
            waits, ready = os.pipe()
            with contextlib.suppress(OSError):  # too many processes
                child = os.fork()
            if not child:
                os.close(waits)
                with _ending_where_it_fails():
                    self._begin(trial, files, ready)
                random.setstate(drawn)
                watch.become(trial, pipe, block)
                return True
            watch.is_parting = False
            os.close(ready)
            begun = os.read(waits, 1)
            os.close(waits)
        for each in files:
            os.close(each)
        number = trial["number"]
        if begun:
            self._children[child] = number
            self._tell("forked", trial=number, process=child, after=watch.pipe.sent_bytes)
        else:
            self._tell("forked", trial=number, process=0, after=0)
        return False

    def _flush(self) -> None:
        """Flush the script's files, once in a pause."""
        if not self._is_flushed:
            gc.unfreeze()  # what is frozen is not listed
            descriptors.flush()
            self._is_flushed = True

    def _begin(self, trial: dict[str, Any], files: tuple[int, int, int], ready: int) -> None:
        """Give a new trial process its own files and streams, while the paused run waits."""
        limits.lead_a_group()
        if trial["limits"] is not None:
            limits.keep(trial["limits"])
        self._socket.close()
        self._children, self._is_trial = {}, True
        private = self._watch.private
        if private is not None:
            private.part(str(trial["number"]))
        edits.write(trial["edits"], private)
        descriptors.replace({self._watch.pipe.descriptor, *files, ready}, private, files[2])
        os.close(files[2])
        os.write(ready, b"1")
        os.close(ready)

    def _shared(self) -> str:
        """Return the resources that a trial would share with the paused run."""
        ours = {self._watch.pipe.descriptor, self._socket.fileno()}
        return descriptors.shared(ours, self._watch.pipe.inode_of_block)


@contextlib.contextmanager
def _ending_where_it_fails() -> Iterator[None]:
    """End a new trial process if an exception occurs, so that its parent notices."""
    try:
        yield
    except BaseException:  # noqa: BLE001 - the script must not go on
        os._exit(1)

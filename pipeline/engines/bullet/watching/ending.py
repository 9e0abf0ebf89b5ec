"""How a script ends: as it would without us, and reported to the recorder."""

from __future__ import annotations

import ctypes
import sys
import traceback
from collections.abc import Callable
from types import TracebackType

from .hooks import Stop, Watch

PR_SET_PDEATHSIG, SIGKILL = 1, 9
"""From Linux's `sys/prctl.h` and `signal.h`."""


def run(watch: Watch, script: Callable[[], None], ours: str) -> None:
    """Run a script to its end, and end the process as it asks.

    Parameters
    ----------
    watch, script
        What watches it, and runs it.
    ours
        The file whose frames are left out of a traceback.
    """
    _end_with_the_recorder()
    code: object = 0
    try:
        script()
        end(watch, "finished")
    except Stop:
        end(watch, "stopped")
    except SystemExit as error:
        code = error.code
        failed = code is not None and code != 0
        end(watch, "failed" if failed else "finished", f"sys.exit({code!r})" if failed else "")
    except KeyboardInterrupt:
        end(watch, "interrupted")
        code = 130
    except BaseException as error:  # noqa: BLE001 - the script's own
        watch.clock.remove()
        end(watch, "failed", in_one_line(error))
        trace = error.__traceback__
        while trace is not None and trace.tb_next and _is_ours(trace, ours):
            trace = trace.tb_next
        sys.excepthook(type(error), error.with_traceback(trace), trace)
        code = 1
    sys.exit(code)  # type: ignore[arg-type]


def end(watch: Watch, how: str, error: str = "") -> None:
    """Send the recorder what is left, and that the script is over."""
    watch.finish()
    watch.lock.remove()
    watch.pipe.note("end", how=how, error=error)
    watch.pipe.flush()


def _is_ours(trace: TracebackType, ours: str) -> bool:
    name = trace.tb_frame.f_code.co_filename
    return name in (ours, __file__) or "runpy" in name


def in_one_line(error: BaseException) -> str:
    """Return an exception's type and message."""
    return " ".join("".join(traceback.format_exception_only(type(error), error)).split())


def _end_with_the_recorder() -> None:
    """Have the system end this process when the recorder is killed: nothing else could stop it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL)

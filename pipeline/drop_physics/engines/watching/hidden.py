"""Hides drop's frames in tracebacks, so that errors look as without drop."""

from __future__ import annotations

import os
from collections.abc import Callable
from types import TracebackType
from typing import Any

from . import ENGINES

_ENGINES = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
OURS = os.path.join(_ENGINES, "")
"""The folder of all of drop's code that runs in the process of a script."""
WRAPPERS = (
    os.path.join(_ENGINES, "watching", ""),
    *(os.path.join(_ENGINES, name, "watch", "") for name in ENGINES),
)
"""The folders whose functions wrap functions of the engines or of Python."""


def hide(error: BaseException) -> None:
    """Remove drop's frames from the near end of a traceback; follow the call with a bare `raise`.

    A bare `raise` adds no frame: Python adds one where an exception arises and where a call returns
    with it, but not where it is raised again. A script that catches, prints or logs the exception
    therefore finds the same frames as without drop.
    """
    trace: TracebackType | None = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename.startswith(WRAPPERS):
        trace = trace.tb_next
    BaseException.with_traceback(error, trace)  # a script's class may have its own


def hiding(call: Callable[..., Any]) -> Callable[..., Any]:
    """Return a wrapper whose frames do not appear in tracebacks."""

    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            return call(*args, **kwargs)
        except BaseException as error:
            hide(error)
            raise

    return called

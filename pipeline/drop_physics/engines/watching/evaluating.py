"""What is evaluated in a run, where the script's own names and its engine are at hand.

An evaluator is a class in a file of ours or of whoever searches, which the script's interpreter
loads by its path: no package has to be there.
"""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .host import EngineWatch


class Evaluator(ABC):
    """An evaluator of a run; its `answer` is what JSON can hold."""

    @abstractmethod
    def step(self, engine: EngineWatch, frame: Any) -> None:
        """See a step that an engine has just made, called from a frame of the script."""

    @abstractmethod
    def answer(self) -> Any:
        """Return what was found, once the script has ended."""


def evaluator_of(given: Mapping[str, Any] | None) -> Evaluator | None:
    """Return an evaluator; None if nothing is evaluated.

    Parameters
    ----------
    given
        The `file` and `name` of its class, and its `arguments`.
    """
    if given is None:
        return None
    spec = importlib.util.spec_from_file_location("_drop_evaluator", given["file"])
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    evaluator: Evaluator = getattr(module, given["name"])(**given["arguments"])
    return evaluator

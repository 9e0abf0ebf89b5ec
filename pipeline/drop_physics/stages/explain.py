"""Say what the codes of findings mean."""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics.errors import ScenarioError
from drop_physics.printable import Printable
from drop_physics.rules.reference import CodeReference, reference_of, references


@dataclass(frozen=True)
class CodeManual(Printable, reported_by="drop_physics.report.explain"):
    """What codes and reasons of findings mean."""

    codes: list[CodeReference]
    """One that was asked for, or all."""


def explain(code: str | None = None, *, every: bool = False) -> CodeManual:
    """Return what a code or a reason means, or what all do.

    Raises
    ------
    ScenarioError
        If there is no such code, or neither or both are asked for.
    """
    if (code is None) is not every:
        raise ScenarioError("give one code of a finding, such as off-target, or --list")
    return CodeManual([*references().values()] if code is None else [reference_of(code)])

"""The command `explain`: describes the meaning of finding codes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from drop_physics.drop.findings import ALL_RULES
from drop_physics.engines.cures import call_of
from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.rules.reference import Blank, CodeReference, reference_of, references
from drop_physics.stages import verbs
from drop_physics.stages.verbs.taken import takes_those_of


@dataclass(frozen=True)
class CodeManual(Printable, reported_by="drop_physics.report.explain"):
    """The meaning of codes and reasons of findings."""

    codes: list[CodeReference]
    """The requested code, or all codes."""


@takes_those_of(verbs.ExplainArguments)
def explain(asked: verbs.ExplainArguments) -> CodeManual:
    """Return the meaning of a code or a reason, or of all codes.

    Raises
    ------
    ScenarioError
        If there is no such code, or neither or both of code and reason are given.
    """
    if (asked.code is None) is not asked.every:
        raise ScenarioError("give one code of a finding, such as off-target, or --list")
    if asked.code is None:
        codes = [*references(ALL_RULES).values()]
    else:
        codes = [reference_of(asked.code, ALL_RULES)]
    return CodeManual([_with_calls(code) for code in codes])


def _with_calls(code: CodeReference) -> CodeReference:
    """Return the meaning of a code, with calls that may fix the problem."""
    said = {False: [*code.advises], True: [*code.proposes]}
    for engine, cure, proposed in code.cures:
        said[proposed].append(_blanked(call_of(engine)(cure)))
    advises, proposes = ([*dict.fromkeys(said[which])] for which in (False, True))
    return replace(code, advises=advises, proposes=proposes)


def _blanked(call: str) -> str:
    """Replace arguments of a call that depend on the script by `…`."""
    if not isinstance(call, Message):
        return call.replace("nan", "…")
    blanks = {name: Blank("…") if each != each else each for name, each in call.values.items()}
    return Message(call.template, **blanks)

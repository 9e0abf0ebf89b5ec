"""Print what the analysis of a recording found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drop_physics.console.output import counted, note, print_json, print_lines
from drop_physics.console.words import unfinished
from drop_physics.messages import Message
from drop_physics.rules.choice import EVERY, Choice

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis


def show_analysis(
    analysis: Analysis, *, as_json: bool, verbose: bool = False, choice: Choice = EVERY
) -> int:
    """Print what `analyze` found, and return the exit code: 3 if that is too grave."""
    if analysis.partial:
        note(unfinished(analysis.recording, _samples(analysis)))
    if analysis.lacks is not None:
        note(analysis.lacks)
    if as_json:
        print_json(analysis.as_json())
    else:
        print_lines(*analysis_lines(analysis, verbose=verbose))
    grave = choice.grave(analysis.findings)
    if grave:
        note(
            Message(
                "{findings} of level {level} or graver: {codes}",
                findings=counted(len(grave), "finding"),
                level=choice.fail_on,
                codes=", ".join(dict.fromkeys(each.code for each in grave)),
            )
        )
    return 3 if grave else 0


def analysis_lines(analysis: Analysis, *, verbose: bool = False) -> list[str]:
    """Tell what happened, in lines as wide as the terminal."""
    from drop_physics.console.bodies_told import lines_of_bodies
    from drop_physics.console.drop_told import lines_of_drop
    from drop_physics.drop.results import DropAnalysis

    if isinstance(analysis, DropAnalysis):
        return lines_of_drop(analysis, verbose=verbose)
    return lines_of_bodies(analysis, verbose=verbose)


def _samples(analysis: Analysis) -> int:
    if analysis.kind == "drop":  # whose floor has no samples of its own
        return analysis.samples
    return sum(sum(body.segments.values()) for body in analysis.bodies)

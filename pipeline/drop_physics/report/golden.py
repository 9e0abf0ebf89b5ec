"""The report of a golden test in pytest: passed, or the first difference."""

from __future__ import annotations

from pathlib import Path

from drop_physics.messages import Message, harmless, translated
from drop_physics.report.check import append_summary, first_words
from drop_physics.stages.check import check


def failure(
    name: str, path: Path, golden: Path, tolerance_m: float, update: bool, summary: str | None
) -> str:
    """Compare a recording with the golden one, or replace it; return the failure, or "".

    The first line of the failure, which pytest repeats in its summary, states the first difference.
    The verdict of `drop check` is also appended to the file `summary`.
    """
    if update:
        golden.parent.mkdir(parents=True, exist_ok=True)
        check(path, golden, tolerance_m=tolerance_m, update=True)
        return ""
    if not golden.exists():
        return translated(
            Message(
                "golden {name}: there is none; make it with: pytest --update-golden\n{path}",
                name=name,
                path=golden,
            )
        )
    checked = check(path, golden, tolerance_m=tolerance_m)
    if summary:
        append_summary(checked, Path(summary))
    if checked.same:
        return ""
    first = translated(
        Message("golden {name}: {difference}", name=name, difference=first_words(checked))
    )
    look = Message(
        "if the change is intended: pytest --update-golden; to look at both: drop view {path} "
        "{golden}",
        path=path,
        golden=golden,
    )
    return f"{harmless(first)}\n\n{checked}\n{translated(look)}"

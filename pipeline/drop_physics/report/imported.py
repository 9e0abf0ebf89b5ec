"""The report of imported states: the file, the engine compared with, commands to run next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from drop_physics.fields import counted
from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import Fact, Facts, File, Report, Section
from drop_physics.report.words import NEXT

if TYPE_CHECKING:
    from drop_physics.stages.importing import Imported


def report_of(imported: Imported) -> Report:
    """Report the contents of a file of states, and whether MuJoCo reproduces its steps."""
    facts = Message(
        "{states}, {bodies}, {megabytes:.2f} MB, {wall_s:.1f} s",
        states=counted(imported.states, "state"),
        bodies=counted(imported.bodies, "body", "bodies"),
        megabytes=imported.bytes / 1e6,
        wall_s=imported.wall_s,
    )
    rows: list[Fact | File] = [File(Message("imported"), imported.recording, facts)]
    rows += _listed(Message("read"), _read(imported))
    rows += _listed(Message("ended"), [imported.ended] if imported.ended else [])
    rows += _listed(Message("steps"), imported.said)
    rows += _listed(Message("missing"), imported.notes)
    command = shell_command("drop", "analyze", imported.recording)
    rows.append(Fact(NEXT, command, "dim", is_command=True))
    return Report(sections=[Section([Facts(rows)])])


def _read(imported: Imported) -> Iterator[Message]:
    """Describe the arrays that were read, and the world that they belong to."""
    named = (
        what if key.rpartition("/")[2] == what else f"{what} ({key})"
        for what, key in imported.arrays.items()
    )
    yield Message(
        "{arrays}; rounding {rounding:.1e}, {step:.4g} s apart",
        arrays=", ".join(named),
        rounding=imported.rounding,
        step=imported.step_s,
    )
    if imported.world is not None:
        yield Message(
            "world {world} of {worlds:,}: --world takes another",
            world=imported.world,
            worlds=imported.worlds,
        )


def _listed(title: Message, sentences: Any) -> Iterator[Fact]:  # noqa: ANN401 - any iterable
    """Yield sentences, the first of them with a title."""
    for number, sentence in enumerate(sentences):
        yield Fact(title if not number else "", sentence, "dim")

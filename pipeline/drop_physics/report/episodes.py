"""The report of a run's episodes: a line for the one examined, and a summary of all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from drop_physics.fields import counted
from drop_physics.messages import Message, joined
from drop_physics.quantities import number, quantity
from drop_physics.report.blocks import Fact, Facts, Section

if TYPE_CHECKING:
    from drop_physics.account.episodes import AtEnd, EpisodeRow

COLUMN = 9
"""Width of the column of headings."""
MOST, MOST_JOINTS = 20, 3
"""Most episodes listed with --verbose, and most joints in a line."""
ENDED = {
    "terminated": Message("terminated"),
    "truncated": Message("truncated"),
    "reset": Message("reset"),
    "run": Message("the run ended"),
}
"""Descriptions of how an episode can end."""
OF_SEVERAL = {
    "terminated": Message("terminated"),
    "truncated": Message("truncated"),
    "reset": Message("ended by a reset"),
    "run": Message("ended with the run"),
}
"""Descriptions of endings after a number of episodes, as in "3 terminated"."""


def episode_lines(
    rows: Sequence[EpisodeRow], looked_at: int | None, samples: int, *, verbose: bool
) -> Iterator[Section]:
    """Yield a line for the examined episode and a summary; with `verbose` a line per episode.

    `samples` is the number of samples of the run.
    """
    if all(row.length is None and row.ended == "run" for row in rows):
        return  # without environments and resets a run has no episodes
    heading, facts = Message("episode"), list[Fact]()
    told = [row for row in rows if row.number == looked_at] or ([] if len(rows) > 1 else rows)
    if not told:
        facts.append(Fact(heading, _together(rows)))
    else:
        facts += [Fact(heading, line_of(row, len(rows)), "bold") for row in told]
        if len(rows) > 1:
            facts.append(Fact("", _together(rows)))
    if over := _steps_over(rows, samples):
        facts.append(Fact("", Message("{steps} follow without a reset", steps=over)))
    if verbose and len(rows) > 1:
        facts += [Fact("", line_of(row, len(rows))) for row in rows[:MOST] if row not in told]
    yield Section([Facts(facts, COLUMN)])


def _steps_over(rows: Sequence[EpisodeRow], samples: int) -> Message | None:
    """Return the number of steps after the last episode of a run's environment; None for none."""
    ended = all(row.length is not None and row.ended in ("terminated", "truncated") for row in rows)
    after = samples - 1 - max((row.last_step for row in rows), default=0)
    if not rows or not ended or len({row.client for row in rows}) > 1 or after <= 0:
        return None
    return counted(after, "step")


def ended_well(rows: Sequence[EpisodeRow]) -> bool:
    """Return whether all episodes ended without failure."""
    ways = [row.ended in ("terminated", "truncated") and not row.failed for row in rows]
    return bool(ways) and all(ways)


def line_of(row: EpisodeRow, count: int) -> Message:
    """Describe an episode in a line: its time, how it ended, and joints at their limits."""
    how: Message = ENDED[row.ended]
    if row.why:
        how = Message("{how}: {why}", how=how, why=row.why)
    parts = [
        Message(
            "{number} of {count} ended at {time:.4g} s ({how})",
            number=row.number,
            count=count,
            time=row.end_s,
            how=how,
        )
        if row.kept
        else Message(
            "{number} of {count}, of which no step is recorded ({how})",
            number=row.number,
            count=count,
            how=how,
        )
    ]
    if row.success is not None:
        reached = Message("its goal reached"), Message("its goal not reached")
        parts.append(reached[not row.success])
    if row.length is None:
        parts.append(counted(row.last_step - row.first_step, "step"))
    else:
        parts.append(
            Message(
                "{steps} of its environment, return {reward}",
                steps=counted(row.length, "step"),
                reward=number(row.reward or 0.0),
            )
        )
    if ended_well([row]):
        return joined("; ", parts)
    if row.first_contact is not None:
        parts.append(
            Message(
                "first contact {links} at {time:.4g} s",
                links=" × ".join(row.first_contact.links),
                time=row.first_contact.time_s,
            )
        )
    shares = [
        Message("{share:.0%} of the steps with {what}", share=share, what=what)
        for share, what in (
            (row.at_limit, Message("a drive at its limit")),
            (row.at_stop, Message("a joint at its stop")),
            (row.slipping, Message("a contact that slips")),
        )
        if share is not None and share >= 0.005
    ]
    return joined("; ", [*parts, *_at_end(row.at_end), *shares])


def _at_end(held: Sequence[AtEnd]) -> Iterator[Message]:
    """Describe the joints that are at their limits until the end, the earliest first."""
    ordered = sorted(held, key=lambda each: (each.at_stop, each.limit or 0.0, each.since_s))
    for (at_stop, limit), alike in groupby(ordered, key=lambda each: (each.at_stop, each.limit)):
        its = [*alike]
        names = [each.joint for each in its[:MOST_JOINTS]]
        more = [Message("{n} more", n=len(its) - len(names))] if len(its) > len(names) else []
        joints = joined(", ", [*names, *more])
        since_s = its[0].since_s
        if at_stop:
            yield Message("from {time:.3g} s on {joints} at the stop", time=since_s, joints=joints)
        elif limit is None:
            yield Message("from {time:.3g} s on {joints} at the limit", time=since_s, joints=joints)
        else:
            yield Message(
                "from {time:.3g} s on {joints} at the limit of {limit}",
                time=since_s,
                joints=joints,
                limit=quantity(limit, its[0].unit),
            )


def _together(rows: Sequence[EpisodeRow]) -> Message:
    """Summarize episodes: how many ended in which way, and their returns."""
    ways = Counter(row.ended for row in rows)
    ended = joined(
        ", ",
        [
            Message("{n} {how}", n=ways[how], how=word)
            for how, word in OF_SEVERAL.items()
            if ways[how]
        ],
    )
    parts = [Message("{episodes}: {ended}", episodes=counted(len(rows), "episode"), ended=ended)]
    returns = [row.reward for row in rows if row.reward is not None]
    if len(returns) > 1:
        low, high = number(min(returns)), number(max(returns))
        parts.append(Message("returns {low} to {high}", low=low, high=high))
    return joined("; ", parts)

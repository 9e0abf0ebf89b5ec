"""Analyzes a recording: explains every body, and applies every rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from drop_physics.account.account import Account
from drop_physics.account.episodes import EpisodeTable
from drop_physics.account.joints import JointTable
from drop_physics.account.rows import AccountRow
from drop_physics.account.touches import TouchTable
from drop_physics.analysis.bodies import BodyStory
from drop_physics.analysis.citing import citing
from drop_physics.analysis.phases import runs_of
from drop_physics.analysis.results import Analysis, Explained
from drop_physics.explain import recording
from drop_physics.explain.curves import CurveTable
from drop_physics.explain.joints import DrivenJoints
from drop_physics.explain.moments import end_of
from drop_physics.explain.recording import Explanation
from drop_physics.explain.replayed import Replayed
from drop_physics.explain.rows import MOST_ROWS, SHOWN_PER_S, SampleRows, joined
from drop_physics.explain.times import StepTimes
from drop_physics.physics.base import Law
from drop_physics.physics.laws.lookup import step_law
from drop_physics.rules.answer import Finding, Scene
from drop_physics.rules.every import Rules, ranked, told_apart
from drop_physics.trace.cures import Cure
from drop_physics.trace.episodes import Episode, episode_at, episodes_of
from drop_physics.trace.history import Piece, Seen


class Story:
    """Reads a recording once, and collects everything that the analysis needs.

    Parameters
    ----------
    seen
        The recorded data.
    origin
        The script's properties, and how it ended.
    at_s
        Times [s] at which the errors of flights are broken down, in addition to the end of each
        flight.
    sums_at_s
        Times [s] whose steps are reported as sums.
    whole
        Whether the table has all rows even of a long recording, and columns for joints and terms.
    episode
        The episode whose end the account and the joint tables describe; None for the whole run.
    about
        The body, link or joint whose rows begin the account; None for no preference.
    asked
        Whether rules are applied.
    other
        The law of one body in flight, for a drop in another engine than PyBullet.
    call_of
        A function that returns the code of a cure, as a user of the engine would write it.
    reports
        A function that returns whether a finding is reported.
    also
        A function that is called with each chunk.
    """

    def __init__(
        self,
        seen: Seen,
        origin: Mapping[str, Any],
        *,
        at_s: Sequence[float] = (),
        sums_at_s: Sequence[float] = (),
        whole: bool = False,
        episode: Episode | None = None,
        about: str | None = None,
        asked: bool = True,
        other: Law | None = None,
        call_of: Callable[[Cure], str] = lambda cure: cure.call,
        reports: Callable[[Finding], bool] = lambda _: True,
        also: Callable[[Piece], None] | None = None,
    ) -> None:
        clients = {each.client for each in seen.settings}
        times = {client: StepTimes(seen, client) for client in clients}
        self._window = None if episode is None else end_of(episode, times[episode.client])
        if self._window is not None:
            _, first, last = self._window
            seen = replace(seen, cuts=(first + 1, last + 1))
        self.explanation: Explanation | Replayed = (
            Replayed(seen) if step_law(seen.engine) is None else Explanation(seen, other)
        )
        episodes = episodes_of(seen) if asked else []
        self.scene = Scene(
            seen=seen,
            origin=origin,
            times=times,
            telemetry=DrivenJoints(seen),
            touches=TouchTable(seen),
            episodes=episodes,
            call_of=call_of,
        )
        self.curves = CurveTable(seen, self.scene.times)
        self._rules = Rules(self.scene) if asked else None
        self._joints = JointTable()
        self._touches = self.scene.touches if episode is None else TouchTable(seen)
        """The pairs to report: over all steps, or at the end of the episode."""
        tables = self._joints, self._touches, self.scene.actuators
        self._account = Account(seen, times, *tables) if asked else None
        shown = episodes[0] if len(episodes) == 1 else episode
        self._episodes = EpisodeTable(seen, times, episodes, shown)
        self._episode, self._about = episode, about
        self._seen, self._origin = seen, origin
        self._whole, self._also, self._reports = whole, also, reports
        self._rows: list[SampleRows] = []
        ends_s = [
            self.scene.times[body.client].of(seen.steps_of(body.client))
            for body in seen.bodies.values()
        ]
        together_s = max(sum(abs(end_s) for end_s in ends_s), 1.0)
        few = sum(seen.samples.values()) * max(1, len(seen.bodies)) <= MOST_ROWS
        self._shown_per_s = np.inf if whole or few else min(SHOWN_PER_S, MOST_ROWS / together_s)
        self.bodies = {
            number: BodyStory(self.scene, body, at_s=at_s, sums_at_s=sums_at_s)
            for number, body in sorted(seen.bodies.items())
        }

    def see(self, explained: recording.ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
        self.scene.see(explained)
        if self._also is not None:
            self._also(explained.piece)
        joints, pairs = self.scene.telemetry.latest, self.scene.chunk.pairs
        self.curves.add(explained, joints, pairs)
        if self._rules is not None:
            self._rules.see()
        self._episodes.see(explained, joints, pairs)
        if self._is_told(explained.piece):
            self._joints.add(self.scene.telemetry)
            if self._touches is not self.scene.touches:
                self._touches.add(explained, pairs)
            if self._account is not None:
                self._account.see(explained, joints, pairs.points)
        touched = runs_of(explained)
        for number, judged in explained.bodies.items():
            history = explained.histories[number]
            rows = self.bodies[number].add(
                judged, history, touched.get(number, ()), detailed=self._whole
            )
            self._rows.append(rows.shown(per_s=self._shown_per_s))
        self.scene.forget()

    def _is_told(self, piece: Piece) -> bool:
        """Return whether the account includes a chunk, which it can only do as a whole."""
        if self._window is None:
            return True
        _, first, last = self._window
        return first < piece.first and piece.end <= last + 1

    @np.errstate(all="ignore")  # of states that are not finite: reported
    def analysis(self) -> Analysis:
        """Process all chunks, freeing each before the next is read; return the results."""
        for _ in map(self.see, self.explanation.pieces()):
            pass
        totals = self.explanation.totals
        account: Sequence[AccountRow] = []
        if self._account is not None:
            account = self._account.ranked(self._told, self._about)
        by_body = {n: body.explained(totals.get(n)) for n, body in self.bodies.items()}
        return Analysis(
            origin=dict(self._origin),
            engine=_engine(self._seen),
            samples=max(self._seen.samples.values(), default=0),
            stepped=[each - 1 for each in self._seen.samples.values() if each > 1],
            explained=_together([*by_body.values()]),
            bodies=[
                replace(
                    body.result(totals.get(n)),
                    joints=self._joints.rows(n),
                    touches=self._touches.rows(n),
                )
                for n, body in self.bodies.items()
            ],
            findings=[*citing(self.findings(), account)],
            account=account,
            episodes=self._episodes.rows(),
            episode=None if self._episode is None else self._episode.number,
            left_out=len(self.findings(reported=False)),
            by_body=by_body,
            rows=joined(self._rows),
            curves=self.curves,
        )

    def findings(self, *, reported: bool = True) -> list[Finding]:
        """Return the findings of all rules, or the suppressed ones, most severe first.

        Call this after the last chunk.
        """
        found = ranked(each for each in self._found if self._reports(each) == reported)
        return [*self._placed(told_apart(found, self._seen.bodies.values()))]

    def _placed(self, findings: Iterable[Finding]) -> Iterator[Finding]:
        """Yield findings with the episode of their steps, if there are several episodes."""
        episodes = self.scene.episodes
        clients = {body.label: body.client for body in self._seen.bodies.values()}
        for finding in findings:
            steps, client = finding.steps, clients.get(finding.body or "")
            if len(episodes) < 2 or steps is None or client is None:
                yield finding
                continue
            first, last = episode_at(episodes, client, [steps.first, steps.last]).tolist()
            yield replace(finding, episode=first if first == last and first else None)

    @cached_property
    def _told(self) -> list[AccountRow]:
        """The rows of the account, unsorted."""
        totals = self.explanation.totals if self._window is None else {}
        return [] if self._account is None else self._account.rows(totals)

    @cached_property
    def _found(self) -> list[Finding]:
        return [] if self._rules is None else [*self._rules.findings(self._told)]


def _together(parts: Sequence[Explained]) -> Explained:
    first = min(
        (part for part in parts if part.until_s is not None),
        key=lambda each: each.until_s or 0.0,
        default=None,
    )
    return Explained(
        samples=sum(part.samples for part in parts),
        of=sum(part.of for part in parts),
        remainder=max((part.remainder for part in parts), default=0.0),
        until_s=None if first is None else first.until_s,
        why=None if first is None else first.why,
    )


def _engine(seen: Seen) -> dict[str, Any]:
    last = {settings.client: settings for settings in seen.settings}
    return {
        str(client): {name: np.asarray(value).tolist() for name, value in each.values.items()}
        | ({"engine": each.engine} if each.engine else {})
        for client, each in sorted(last.items())
    }

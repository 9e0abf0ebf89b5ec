"""Proposes changes to try: suggested fixes of findings, requested ones, and calls to omit."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics.engines.cures import ROWS, trial_of, words_of
from drop_physics.engines.interventions import FACTOR, Interventions
from drop_physics.engines.source import SOURCE, place_of
from drop_physics.errors import ScenarioError
from drop_physics.experiments.interventions import Intervention
from drop_physics.messages import Message
from drop_physics.stages.rerun.single import SINGLE, named
from drop_physics.trace.cures import ChangedRun, Cure, Scope
from drop_physics.trace.events import located

if TYPE_CHECKING:
    from drop_physics.engines.watching.single_changes import Change
    from drop_physics.rules.answer import Finding
    from drop_physics.trace.history import Seen

READING = "reading"
"""Code of the findings about a number that the script reads; no run can test these."""
WITHOUT = ("left-out", "default")
"""Operators that leave out a call or a statement, or an argument of a call."""


@dataclass
class Candidate:
    """A change to try, and the indices of the findings that suggest it."""

    intervention: Intervention
    run: ChangedRun | None
    """The run with the intervention; None if the engine does not support it."""
    findings: list[int] = field(default_factory=list)


class Proposals:
    """Proposes changes to try in a script, from its unchanged run.

    Parameters
    ----------
    seen
        The recorded data of the script's own run.
    findings
        The findings about that run.
    cures
        The table of cures for the run's engine.
    possible
        Returns the single changes that are possible in the run; called only if the user names one.
    """

    def __init__(
        self,
        seen: Seen,
        findings: Sequence[Finding],
        cures: Interventions,
        possible: Callable[[], Sequence[Change]] = list,
    ) -> None:
        self._seen, self._findings, self._cures = seen, findings, cures
        self._possible = functools.cache(possible)
        settings = [each.values.get("fixedTimeStep") for each in seen.settings]
        self._timestep_s = float(np.ravel(settings[-1])[0]) if settings else 1 / 240  # type: ignore[arg-type]
        self._commanded: frozenset[tuple[int, int]] | None = None

    def of_findings(self) -> list[Candidate]:
        """Return the fixes that findings suggest, in order, without duplicates."""
        found: dict[Any, Candidate] = {}
        for place, finding in enumerate(self._findings):
            if finding.cure is None or finding.code == READING:  # not about what the bodies do
                continue
            candidate = self._candidate(replace(finding.cure, call=""), finding)
            places = found.setdefault(candidate.intervention, candidate).findings
            if place not in places:
                places.append(place)
        return [*found.values()]

    def always(self, *, damped: bool) -> list[Candidate]:
        """Return the changes that are always tried, such as a finer timestep.

        Damping is among them if it acts on a body in free flight.
        """
        cures = [Cure("timestep", value=2.0), Cure("solver", value=500.0)]
        if damped:
            cures.append(Cure("damping", value=0.0))
        return [*map(self.whole, cures)]

    def asked(self, cures: Sequence[Cure], about: Sequence[int]) -> list[Candidate]:
        """Return the requested changes, applied to the bodies and joints of the findings."""
        found: list[Candidate] = []
        named = [self._findings[place] for place in about]
        for cure in cures:
            if cure.name == SINGLE:
                found.append(self._single(cure, list(about), words=True))
                continue
            proposes = [one for one in named if one.cure is not None and one.cure.name == cure.name]
            of = [] if ROWS[cure.name].whole_run else named
            candidates = [
                self._candidate(replace(cure, target=one.joint or one.body), one) for one in of
            ] or [self.whole(cure)]
            if cure.value is None and proposes:  # what a finding says itself is meant
                candidates = [self._candidate(each.cure, each) for each in proposes if each.cure]
            for candidate in candidates:
                candidate.findings += about
            # What comes to the same calls is one trial, whatever it was made on.
            found += {repr(each.run): each for each in reversed(candidates)}.values()
        return found

    def left_out(self) -> list[Candidate]:
        """Return calls, arguments and statements that set something, each to be omitted once."""
        changes = (
            each for each in self._possible() if each.op in WITHOUT and each.site is not None
        )
        return [_changed(each, Cure("without", call=self._without(each))) for each in changes]

    def _without(self, change: Change) -> str:
        """Describe what a change omits, without the source line."""
        if change.engine == SOURCE:
            return Message("without {was}", was=place_of(change)[1])
        function, _, argument = change.change.partition(".")
        form = "argument" if argument else ""
        given = {"function": function, "argument": argument}
        return self._cures.call_of(Cure("without", form=form, given=given))

    def required(self, cure: Cure, option: str) -> ChangedRun:
        """Return the run with a change applied to the whole run.

        Raises
        ------
        ScenarioError
            If the engine does not support the change.
        """
        run = self.whole(cure).run
        if run is None:
            raise ScenarioError(
                "{option} {name} is no option of {engine}, which steps the script",
                option=option,
                name=cure.call,
                engine=self._seen.engine,
            )
        return run

    def whole(self, cure: Cure) -> Candidate:
        """Return the candidate for a change to the whole run; some values are factors."""
        if cure.name == SINGLE:
            return self._single(cure, [], words=False)
        is_factor = f"{cure.name}:{FACTOR}" in self._cures.rows
        if is_factor and cure.value is not None and cure.value >= 0:
            cure = replace(cure, form=FACTOR)
        scope = Scope([*self._seen.bodies.values()], timestep_s=self._timestep_s, whole=True)
        return self._made(cure, scope, whole=True)

    def _single(self, cure: Cure, findings: list[int], *, words: bool) -> Candidate:
        """Return the candidate for a change that a user names, such as `geom_friction *10`."""
        change = named(cure.call, self._possible())
        operand = change.how[1]
        asked = Cure(
            cure.call,
            ", ".join(change.target) or None,
            operand if isinstance(operand, int | float) else None,
            words_of(change) if words else cure.call,
        )
        return replace(_changed(change, asked), findings=findings)

    def _candidate(self, cure: Cure, finding: Finding) -> Candidate:
        labels = {body.label: body for body in self._seen.bodies.values()}
        bodies = [labels[each] for each in cure.bodies or (finding.body,) if each in labels]
        other = labels.get(finding.other or "")
        if not bodies or (finding.bodies > 1 and not cure.bodies):
            bodies = [*labels.values()]
        joint = cure.target if len(bodies) == 1 and cure.target == finding.joint else None
        target = joint or (bodies[0].label if len(bodies) == 1 else None)
        scope = Scope(bodies, joint, finding.site, other, cure.target, timestep_s=self._timestep_s)
        return self._made(replace(cure, target=target), scope, whole=False)

    def _made(self, cure: Cure, scope: Scope, *, whole: bool) -> Candidate:
        if whole or ROWS[cure.name].whole_run:
            whole, scope, cure = True, replace(scope, joint=None), replace(cure, target=None)
        cure = replace(cure, call=cure.call or self._cures.call_of(cure))
        numbers = None if whole else tuple(body.number for body in scope.bodies)
        if cure.name == "default-motor-off":
            scope = replace(scope, commanded=self._motors())
        row = self._cures.row_of(cure) or ROWS[cure.name]
        what = Intervention(cure, numbers, scope.joint, scope.site, row.decides)
        return Candidate(what, self._cures.applied(cure, scope))

    def _motors(self) -> frozenset[tuple[int, int]]:
        """Return the joints, by body and link, that calls drive by motors but never by torques."""
        if self._commanded is None:
            found = set()
            for piece in self._seen.pieces():
                for each in piece.calls.commands():
                    modes = np.ravel(each.values["controlMode"])
                    which = modes != 1
                    for engine_id in np.unique(each.bodies[which]).tolist():
                        links = each.joints[which & (each.bodies == engine_id)]
                        bodies = [
                            body.number
                            for body in self._seen.bodies.values()
                            if (body.client, body.engine_id) == (each.client, engine_id)
                        ]
                        found |= {(n, link) for n in bodies for link in np.unique(links).tolist()}
            self._commanded = frozenset(found)
        return self._commanded


def _changed(change: Change, cure: Cure) -> Candidate:
    """Return the candidate for a change that the user named."""
    site = None if change.site is None else located(*change.site)
    return Candidate(Intervention(cure, site=site), trial_of(change))

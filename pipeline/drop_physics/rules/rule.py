"""The mechanism of rules: where in a table a rule holds, and what is reported of the worst case.

    @joint_rule("target-clamped", "asked")
    def target_clamped(joints: JointColumns) -> Match: ...      # a mask, a size, numbers

    target_clamped.rows(SayingRow(...), SayingRow(...))        # sentences, and cures (`rows`)

    @target_clamped.counts
    def _(size: Float64, count: Int64) -> Float64: ...         # sizes of columns, 0 if not told

This module handles chunks and runs of consecutive steps, finds the worst row, and determines the
count and steps, joints, bodies and script lines that a finding states. There are tables of joints,
actuators, pairs of touching bodies, and bodies (`tables`). A rule on the account returns whether it
applies to an account row. A rule on calls yields its cases once, at the end of the run, and has
rows in the same way:

    @input_rule("not-taken", "asked", "other-client")
    def other_client(inputs: Inputs) -> Iterator[Case]: ...

Further parameters name the tables of the scene that a function reads, such as `placing: Placing`.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.account.rows import AccountRow
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.physics.vectors import distinct_rows, groups
from drop_physics.rules.answer import Finding, Proof, Scene, and_more
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.by_name import called
from drop_physics.rules.codes import Level
from drop_physics.rules.earlier import EarlierRows
from drop_physics.rules.engines import BULLETS, engine_of
from drop_physics.rules.joint import link_of, units
from drop_physics.rules.rows import Case, Noted, SayingRow, Worst
from drop_physics.rules.runs import Kind, Runs
from drop_physics.rules.tables import TABLES, RuleTable, TableName, tables
from drop_physics.rules.thresholds import MINOR
from drop_physics.trace.episodes import episode_at

Numbers = Mapping[str, Any]
"""Columns by name; a single number applies to all rows."""


@dataclass(frozen=True, eq=False)
class Match:
    """Where in a table a rule holds, and how grave each row is; arrays have the table's shape.

    If `where` has row indices, arrays may have its shape instead. A single number applies to all
    rows, and a two-dimensional array to all planes of a three-dimensional table.
    """

    where: NDArray[Any]
    size: Float64
    """The magnitudes of the problem, by which the worst row is chosen."""
    numbers: Numbers = field(default_factory=dict)
    sums: Numbers = field(default_factory=dict)
    """Numbers to sum over the rows; `until_` plus the name is the sum up to the largest row."""
    most: Numbers = field(default_factory=dict)
    """Numbers of which the maximum is kept."""
    firsts: Numbers = field(default_factory=dict)
    """Numbers of which the first row's value is kept."""
    lasts: Numbers = field(default_factory=dict)
    """Numbers of which the last row's value is kept."""
    keys: Int64 | None = None
    """The subject of each row, if it differs from the table's: shape (rows, k)."""

    counts: Int64 | None = None
    """Number of steps of each row in which the rule holds; None for all."""
    begins: Flags | None = None
    """Rows in which a new run begins, even directly after another one."""
    holds: Flags | None = None
    """Rows in which the rule holds, if that is only known afterwards; None for all."""

    def runs(self, table: RuleTable) -> Runs:
        """Return the rows in which the rule holds, before merging them over steps."""
        where = self.where
        chosen = where.dtype == np.bool_
        places = np.nonzero(where) if chosen else (where,)

        def rows(values: NDArray[Any]) -> NDArray[Any]:
            values = np.asarray(values)
            if (values.ndim, where.ndim) == (2, 3):  # the same in all planes
                values = values[:, :, None]
            if values.shape[: where.ndim] != where.shape:
                values = np.broadcast_to(values, where.shape)
            return values[places] if chosen else values

        steps = table.step[places[0]]
        counts = np.ones_like(steps) if self.counts is None else rows(self.counts)
        columns: dict[str, tuple[Kind, NDArray[Any]]] = {
            "first": ("first", steps),
            "last": ("last", steps),
            "count": ("sum", counts),
            "size": ("at", rows(self.size)),
        }
        if self.counts is not None:  # the first and the last step in which it holds
            held = np.where(counts[:, None] > 0, np.column_stack([-steps, steps]), -(1 << 40))
            columns["within"] = "most", held
        if self.begins is not None:
            columns["begins"] = "first", rows(self.begins)
        kinds: dict[Kind, Numbers] = {
            "at": {**table.noted, **self.numbers},
            "sum": self.sums,
            "until": {f"until_{name}": each for name, each in self.sums.items()},
            "most": self.most,
            "first": self.firsts,
            "last": self.lasts,
        }
        for kind, told in kinds.items():
            columns |= {name: (kind, rows(each)) for name, each in told.items()}
        keys = table.keys[places[0]] if self.keys is None else rows(self.keys)
        found = Runs(np.column_stack([keys, *places[1:]]), columns)
        return found if self.holds is None else found.at(self.holds)


@dataclass(frozen=True, eq=False)
class Sized:
    """Runs of steps in which a rule holds, with their sizes."""

    sizes: Float64
    """The sizes, shape (runs,); 0 for runs to be ignored."""
    numbers: Numbers = field(default_factory=dict)
    graver: Flags | None = None
    """Flags of the runs that rank above others, regardless of their sizes."""

    @property
    def ranks(self) -> Float64:
        """The sort keys of runs, shape (runs, 2): whether they are severe, then their size."""
        graver = np.zeros(len(self.sizes)) if self.graver is None else self.graver
        return np.column_stack([graver, self.sizes])


Measure = Callable[..., Sized | Float64 | float]
"""A function that computes the sizes of runs from their columns; runs of size 0 are ignored."""
Notes = Callable[..., Mapping[str, object] | None]
Noting = TypeVar("Noting", bound=Notes)


class RunsOfBodies:
    """Runs of steps in which a rule holds, with facts about their bodies."""

    def __init__(self, runs: Runs, scene: Scene) -> None:
        self.runs, self.keys, self.scene = runs, runs.keys, scene
        self._numbers: list[int] = runs.keys[:, 0].tolist()

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401
        return self.runs[name] if name in self.runs.columns else getattr(self, name)

    @property
    def ends(self) -> Int64:
        """The last sample of each run's body."""
        return np.array([self.scene.last_samples[number] for number in self._numbers])

    @property
    def sizes_m(self) -> Float64:
        """The size of each run's body."""
        return np.array([size_m(self.scene.seen.bodies[number]) for number in self._numbers])


def nothing() -> Noted:
    """Return no further numbers, for rules that record none."""
    return {}


def every_run(size: Float64) -> Float64:
    """Return sizes unchanged, for rules in which every run of steps counts."""
    return size


@dataclass(eq=False)
class Rule:
    """One rule: where it holds, what it says, and what its code means."""

    code: str
    level: Level
    table: TableName
    matches: Callable[..., Any]
    """The rule's function: returns a `Match` for a table, or None; for inputs, yields findings."""
    reason: str | None = None
    """The cause, as one of the code's reasons."""
    least_count: float = 1
    """Minimum number of steps in which the rule must hold."""
    consecutive: bool = False
    """Whether runs of consecutive steps are kept separate, of which the worst of each key is
    reported."""
    subject: int | None = None
    """Number of key columns that identify a subject; the worst match of each subject is reported.
    None for all columns; with 0 there is one finding for the whole run, about no body."""
    commanded: bool = True
    """Whether a finding about a joint cites the command in effect as its cause."""
    argument: str | None = None
    """The argument of `changeDynamics` whose call is the cause."""
    engines: tuple[str, ...] = BULLETS
    """The engines to which the rule applies: only their recordings are examined."""
    proof: Proof = "sum"
    """The proof of the findings: the sum, or the requests of calls and files."""
    proposes: bool = False
    """Whether the rule's advice is only a proposal: its message states an observation,
    not a cause."""
    sizes: Measure = every_run
    told: Sequence[SayingRow] = ()
    """The rows, of which the first whose condition holds is reported."""
    noting: Notes = nothing
    """Function that returns further numbers of the worst match, by name."""

    @property
    def meaning(self) -> str:
        """The meaning of the code, in one sentence."""
        return (self.matches.__doc__ or "").strip()

    def rows(self, *rows: SayingRow, like: SayingRow | None = None) -> None:
        """Set the rule's messages, of which the first whose condition holds is reported.

        Missing fields of the rows are taken from `like`.
        """
        self.told = [each if like is None else each.like(like) for each in rows]

    def notes(self, noting: Noting) -> Noting:
        """Set the function that computes further numbers; its None means nothing is reported."""
        self.noting = noting
        return noting

    def counts(self, sizes: Measure) -> Measure:
        """Set the function that computes the size of each run of steps; 0 for runs to ignore."""
        self.sizes = sizes
        return sizes

    def finding(self, case: Case, scene: Scene) -> Finding | None:
        """Return the finding for a case; None if there is nothing to report."""
        case.scene = scene
        noted = called(self.noting, case, worst=case)
        if noted is None:
            return None
        case.values |= noted
        row = next((row for row in self.told if self._holds(row, case, scene)), None)
        plain = Finding(
            code=self.code,
            level=self.level,
            reason=self.reason,
            message="",
            proposed=self.proposes,
            proof=self.proof,
            body=None if self.subject == 0 else case.label,
        )
        found = None if row is None else row.finding(case, scene, plain)
        if row is None or found is None:
            return None
        # Rows of one sentence, which differ in their causes, are of one kind.
        place = next(k for k, each in enumerate(self.told) if each.says is row.says)
        return replace(found, kind=(self.matches.__name__, place, noted.get("kind")))

    def _holds(self, row: SayingRow, case: Case, scene: Scene) -> object:
        if engine_of(scene.seen) not in (row.engines or self.engines):
            return False
        return row.when is None or called(row.when, case)


PARTS = "joints", "targets", "actuators"
"""Tables whose columns are parts of a body: only the worst part of each body is reported."""
RULES: list[Rule] = []
"""All rules, in the order in which their modules are imported."""


Matching = Callable[..., Any]
"""The function of a rule: its table first, then the tables of the scene that it names."""
RuleMaker = Callable[[Matching], Rule]


def _maker(
    table: TableName,
    code: str,
    level: Level,
    reason: str | None = None,
    **options: Any,  # noqa: ANN401
) -> RuleMaker:
    def made(matches: Matching) -> Rule:
        RULES.append(Rule(code, level, table, matches, reason, **options))
        return RULES[-1]

    return made


input_rule = partial(_maker, "inputs", proof="call")
"""Decorator for a rule on a run's calls, whose function yields cases."""
joint_rule = partial(_maker, "joints")
"""Decorator for a rule on joints, whose function returns a match: the worst joint of each robot is
reported."""
actuator_rule = partial(_maker, "actuators")
"""Decorator for a rule on actuators, whose function returns a match."""
target_rule = partial(_maker, "targets")
"""Decorator for a rule on the targets of position motors: the worst target of each robot is
reported."""
row_rule = partial(_maker, "account")
"""Decorator for a rule on the account, whose function returns whether the rule is about a row."""
pair_rule = partial(_maker, "pairs")
"""Decorator for a rule on pairs of touching bodies: the finding is about the body with the higher
id."""
side_rule = partial(_maker, "sides")
"""Decorator for a rule on pairs of touching bodies that is applied to both bodies of each pair."""
body_rule = partial(_maker, "bodies")
"""Decorator for a rule on bodies: a table has the steps of all equal bodies, one body after the
other."""


class Rules:
    """Applies all rules that suit a recording's engine, chunk by chunk, to their tables.

    `see` must be called once per chunk, in order, before `findings`.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._rules = [rule for rule in RULES if engine_of(scene.seen) in rule.engines]
        self._open: list[Runs | None] = [None] * len(self._rules)
        """Unfinished runs of each rule, and the worst finished run of each key."""
        self._in: dict[int, set[tuple[int, ...]]] = {}
        """The keys that each rule has matched, with the episode number."""
        self._ended: list[Runs | None] = [None] * len(self._rules)
        self._earlier = EarlierRows()

    def see(self) -> None:
        """Apply the rules to a chunk."""
        read = {rule.table for rule in self._rules}
        names = [each for each in TABLES[2:] if each in read]
        self._look(
            (name, table) for name in names for table in tables(name, self.scene, self._earlier)
        )

    @np.errstate(all="ignore")  # what is not asked for is nan
    def _look(self, seen: Iterable[tuple[TableName, RuleTable]]) -> None:
        """Apply the rules to the tables of a chunk, or to those complete at the end."""
        found: list[list[Runs]] = [[] if each is None else [each] for each in self._open]
        for name, table in seen:
            for place, rule in enumerate(self._rules):
                if rule.table != name:
                    continue
                match = rule.matches(table, **self.scene.read_by(rule.matches, 1))
                if match is not None and len(runs := match.runs(table)):
                    found[place].append(runs)
        for place, parts in enumerate(found):
            if parts:
                consecutive = self._rules[place].consecutive
                if not consecutive:
                    self._note_each(place, parts[self._open[place] is not None :])
                runs = Runs.listed(parts).joined(consecutive=consecutive)
                self._end(place, runs.at(~runs.ends))
                self._open[place] = runs.at(runs.ends)

    def _end(self, place: int, ended: Runs) -> None:
        """Keep the worst finished run of steps for each body or joint."""
        self._note(place, ended)
        before = self._ended[place]
        runs = ended if before is None else Runs.listed([before, ended])
        if len(runs):
            self._ended[place] = runs.greatest(self._sized(place, runs).ranks)

    def _note_each(self, place: int, parts: Sequence[Runs]) -> None:
        """Note in which episodes of a chunk each rule holds."""
        if not parts or len(self.scene.episodes) < 2:
            return
        rows = Runs.listed(parts)
        numbers = self._numbers(rows)
        for number in np.unique(numbers).tolist():
            self._note(place, rows.at(numbers == number).joined(consecutive=False))

    def _note(self, place: int, ended: Runs) -> None:
        """Note in which episodes a rule holds for a body or joint."""
        if len(self.scene.episodes) < 2 or not len(ended):
            return
        counting = ended.at(self._sized(place, ended).sizes > 0)
        numbers = self._numbers(counting)
        rows, _, _ = distinct_rows(np.column_stack([counting.keys, numbers])[numbers > 0])
        self._in.setdefault(place, set()).update(map(tuple, rows.tolist()))

    def _numbers(self, runs: Runs) -> Int64:
        """Return the episode in which each run of steps begins; 0 for none."""
        numbers = np.zeros(len(runs), np.int64)
        for body in np.unique(runs.keys[:, 0]).tolist():
            its = runs.keys[:, 0] == body
            client = self.scene.seen.bodies[body].client
            numbers[its] = episode_at(self.scene.episodes, client, runs["first"][its])
        return numbers

    def _episodes(self, place: int, keys: Int64) -> int:
        """Return the number of episodes in which a rule holds for a body or joint."""
        known = {*map(tuple, keys.tolist())}
        return len({row[-1] for row in self._in.get(place, ()) if row[:-1] in known}) or 1

    @np.errstate(all="ignore")
    def _sized(self, place: int, runs: Runs) -> Sized:
        rule = self._rules[place]
        found = called(rule.sizes, RunsOfBodies(runs, self.scene))
        sized = found if isinstance(found, Sized) else Sized(np.asarray(found))
        return replace(sized, sizes=np.where(runs["count"] < rule.least_count, 0.0, sized.sizes))

    def findings(self, account: Sequence[AccountRow] = ()) -> Iterator[Finding]:
        """Yield the findings of all rules; of a robot's joints, only the worst is reported.

        `account` has the rows of the account.
        """
        self._look(("targets", each) for each in self.scene.standing.left())
        for place, rule in enumerate(self._rules):
            if (last := self._open[place]) is not None:
                self._end(place, last)
            runs = self._ended[place]
            if runs is None:
                continue
            sized = self._sized(place, runs)
            counts = sized.sizes > 0
            runs, ranks = runs.noting(sized.numbers).at(counts), sized.ranks[counts]
            subjects = runs.keys[:, : 1 if rule.table in PARTS else rule.subject]
            if rule.table == "targets":  # what is at its limit is another matter
                subjects = np.column_stack([subjects, runs["weak"]])
            _, _, which = distinct_rows(subjects)
            for _, its in groups(which):
                mine = runs.at(its)
                worst = mine.at(np.lexsort((-mine["count"], *-ranks[its].T[::-1]))[:1])
                alike = ~(mine["size"] < MINOR * worst["size"][0])
                joints, among = (
                    len(distinct_rows(each[:, :2])[0]) for each in (mine.keys, mine.keys[alike])
                )
                finding = self._finding(rule, worst, among, joints)
                if finding is not None:
                    yield replace(finding, episodes=self._episodes(place, mine.keys))
        for rule in [each for each in self._rules if each.table in TABLES[:2]]:
            inputs = rule.table == "inputs"
            read = self.scene.read_by(rule.matches) if inputs else {}
            for case in rule.matches(**read) if inputs else self._of(rule, account):
                if (finding := rule.finding(case, self.scene)) is not None:
                    yield finding

    def _of(self, rule: Rule, account: Sequence[AccountRow]) -> Iterator[Case]:
        """Yield the account's rows for which a rule holds; of a body's joints, only the worst."""
        found: dict[Hashable, list[tuple[float, Case]]] = {}
        for place, row in enumerate(account):
            if rule.matches(row):
                case = Case.of_row(row)
                if (size := float(np.asarray(called(rule.sizes, case)))) > 0:
                    key = (row.body, None) if row.joint else (row.body, place)
                    found.setdefault(key, []).append((size, case))
        for cases in found.values():
            most, worst = max(cases, key=lambda each: each[0])
            among = sum(size >= MINOR * most for size, _ in cases)
            worst.values |= {"size": most, "joints": len(cases), "more": and_more(among)}
            yield worst

    @np.errstate(all="ignore")
    def _finding(self, rule: Rule, worst: Runs, among: int, joints: int) -> Finding | None:
        keys, about, site = worst.keys[0].tolist(), dict[str, Any](), None
        subject = keys[: rule.subject]
        body = self.scene.seen.bodies[keys[0]]
        if rule.table in ("joints", "targets"):
            link = link_of(body, keys[1])
            unit, effort = units(body.joints[link])
            about = {"joint": body.joints[link].name, "link": link, "unit": unit, "effort": effort}
            about |= {"joints": joints, "others": and_more(joints), "more": and_more(among)}
            site = self.scene.telemetry.cited(worst["site"][0]) if rule.commanded else None
        elif rule.table == "actuators":
            actuator = body.actuators[keys[1]]
            joint = actuator.target if actuator.acts_on == "joint" else None
            about = {"actuator": actuator, "name": actuator.name, "joint": joint}
        elif len(subject) > 1:
            partner = self.scene.seen.bodies[keys[1]]
            about = {"partner": partner, "other": partner.label}
        if rule.argument is not None:
            site = self.scene.asked.of[rule.argument].site(*keys[:2])
        return rule.finding(Worst(self.scene, worst, among=among, site=site, **about), self.scene)

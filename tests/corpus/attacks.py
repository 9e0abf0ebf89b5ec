"""Adversarial scenes for one finding code: some must produce the finding, similar ones must not.

`attacks/*.toml` has, of each attack,

    code     the code that is asked for
    script   lines of PyBullet, behind those that connect (`scenes.HEAD`)
    says     cases of which the code is said, once (at least, where `many` is true)
    silent   cases of which it is not, or not so

A `$name` of the script is a number or a text of the case, else of the attack, else of the file's
table `pieces`. A case may also have, or the attack for all of which its code is said,

    words, numbers, joint           what the finding says, as in `truth.toml`
    level, body, other, reason      what else it is
    remedy                          the name of its cure, empty if it has none
    call, count                     a part of the line of its call, and the number of its steps
    ended, error                    how the script ended
    sampled                         whether steps are looked at now and then, in pieces more often
    cure                            other values for names, or a list of such: nothing is said then
    proof                           what is true of its `States` `here` and, with a cure, `cured`; a
                                    silent case has but its own
"""

from __future__ import annotations

import math
import re
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from asked import told_in_pieces, told_whole
from drop_physics.explain.jsonable import jsonable
from drop_physics.recording.reader import Recording
from drop_physics.rules.answer import Finding
from drop_physics.trace.history import Seen
from numpy.typing import NDArray
from scenes import record
from score import Truth, lacking

FOLDER = Path(__file__).with_name("attacks")
SAID = {"words", "numbers", "joint"}
EQUAL = {"level", "body", "other", "reason"}
ENDED = {"ended", "error"}
ABOUT = {*SAID, *EQUAL, *ENDED, "remedy", "call", "count", "many", "sampled", "cure", "proof"}
NAMES = {
    "norm": np.linalg.norm,
    "abs": np.abs,
    "min": np.min,
    "max": np.max,
    "math": math,
    "np": np,
}
"""Functions that a proof expression may call."""
Case = Mapping[str, Any]


@dataclass(frozen=True)
class States:
    """The states of a script's run, by body or joint id, with a row per step."""

    seen: Seen

    def at(self, body: int) -> NDArray[np.float64]:
        """Return the positions of a body's centre of mass, shape (n, 3)."""
        return self._base(body, "position_m")

    def v(self, body: int) -> NDArray[np.float64]:
        """Return the linear velocities of a body, shape (n, 3)."""
        return self._base(body, "velocity_m_s")

    def w(self, body: int) -> NDArray[np.float64]:
        """Return the angular velocities of a body, shape (n, 3)."""
        return self._base(body, "spin_rad_s")

    def turned(self, body: int) -> NDArray[np.float64]:
        """Return the vector parts of a body's quaternions, shape (n, 3)."""
        return self._base(body, "orientation")[:, :3]

    def q(self, body: int, joint: int) -> NDArray[np.float64]:
        """Return the positions of a joint with one degree of freedom, shape (n,)."""
        return np.asarray(self.seen.joints[body].position[:, self._before(body, joint, 0)])

    def rate(self, body: int, joint: int) -> NDArray[np.float64]:
        """Return the velocities of a joint with one degree of freedom, shape (n,)."""
        return np.asarray(self.seen.joints[body].velocity[:, self._before(body, joint, 1)])

    def _before(self, body: int, joint: int, which: int) -> int:
        joints = self.seen.bodies[body].joints
        return sum(each.widths[which] for each in joints if each.link < joint)

    def _base(self, body: int, column: str) -> NDArray[np.float64]:
        rows = self.seen.bases
        return np.asarray(rows[column][rows["body"] == body], dtype=float)


@dataclass(frozen=True)
class Attack:
    """A script template, and the cases in which it must or must not produce a finding code."""

    code: str
    script: str
    says: Sequence[Case] = ()
    silent: Sequence[Case] = ()
    names: Case = field(default_factory=dict)
    """Default values of the template's variables and of its file's."""
    about: Case = field(default_factory=dict)
    """Further values common to all cases that must produce the finding."""

    def scene(self, case: Case) -> str:
        """Return the script of a case."""
        return self.filled(self.script, case)

    def filled(self, text: str, case: Case) -> str:
        """Return a text with a case's values substituted for its variables."""
        before = ""
        while text != before:
            before, text = text, Template(text).safe_substitute({**self.names, **case})
        return text

    def unused(self) -> set[str]:
        """Return the variables of cases that no text uses, e.g. misspelt ones."""
        cases = [self.names, self.about, *self.says, *self.silent]
        cures = [each.get("cure", {}) for each in cases]
        cases += [each for cure in cures for each in ([cure] if isinstance(cure, dict) else cure)]
        texts = [self.script, *(str(value) for case in cases for value in case.values())]
        used = set(re.findall(r"\$\{?(\w+)", "\n".join(texts)))
        used |= {w for each in cases for w in re.findall(r"\w+", str(each.get("proof", "")))}
        return {name for case in cases[1:] for name in case} - ABOUT - used

    def shortfalls(self, folder: Path) -> Iterator[str]:
        """Yield descriptions of how each case, recorded in a folder, fails its requirements."""
        for number, case in enumerate(self.says):
            run = Run(self, {**self.about, **case}, folder)
            lacks = chain(run.lacks(), () if number else run.differs_in_pieces())
            yield from (f"{_short(case)}: {line}" for line in lacks)
        for case in self.silent:
            run = Run(self, case, folder)
            if false := [each for each in run.found if not [*run.differs(each)]]:
                yield f"{_short(case)}: FALSE {false[0].message}"
            if not run.proved():
                yield f"{_short(case)}: not proved"


@dataclass(frozen=True)
class Run:
    """A recorded case."""

    attack: Attack
    case: Case
    folder: Path
    """The folder for recordings."""

    @cached_property
    def recording(self) -> Recording:
        """The recording of the case's script."""
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        return record(self.attack.scene(self.case), folder / "x.rrd", folder=folder)

    @cached_property
    def found(self) -> list[Finding]:
        """The findings with the attack's code."""
        return [each for each in self._told(told_whole) if each.code == self.attack.code]

    def lacks(self) -> Iterator[str]:
        """Yield the case's unmet requirements: missing findings, and findings despite the cure."""
        case, times = self.case, len(self.found)
        if times != 1 and not (times and case.get("many")):
            yield f"said {times} times"
            return
        finding = self.found[0]
        yield from self.differs(finding)
        cures = case.get("cure", {})
        for cure in [cures] if isinstance(cures, dict) else cures:
            cured = Run(self.attack, {**case, **cure}, self.folder) if cure else self
            if cure and cured.found:
                yield f"FALSE of {_short(cure)}: {cured.found[0].message}"
            if not self.proved(finding, cured):
                yield f"not proved of {_short(cure)}, effect {finding.effect}"

    def differs_in_pieces(self) -> Iterator[str]:
        """Yield how findings differ if the recording is read in chunks."""
        pieces = [each for each in self._told(told_in_pieces) if each.code == self.attack.code]
        told = _told_but_numbers if self.case.get("sampled") else _told
        if [*map(told, pieces)] != [*map(told, self.found)]:
            yield f"in pieces {[each.message for each in pieces]}"

    def proved(self, finding: Finding | None = None, cured: Run | None = None) -> bool:
        """Return whether the case's proof expression is true."""
        known = {
            **NAMES,
            **self.attack.names,
            **self.case,
            "here": States(self.recording.seen),
            "cured": States((cured or self).recording.seen),
            "finding": finding,
            "effect": finding.effect.value if finding and finding.effect else None,
        }
        return bool(eval(" ".join(self.case.get("proof", "True").split()), known))

    def _told(self, how: Any) -> list[Finding]:
        origin = {name: self.case[name] for name in ENDED & self.case.keys()}
        with np.errstate(all="ignore"):  # as `analyze` has it
            return list(how(self.recording.seen, **origin))

    def differs(self, finding: Finding) -> Iterator[str]:
        """Yield the properties in which a finding differs from the case's requirements."""
        case, said = self.case, jsonable(finding)
        about = {k: case[k] for k in SAID & case.keys()}
        about["words"] = [self.attack.filled(each, case) for each in case.get("words", [])]
        truth = Truth("", "", [finding.code], **about)
        yield from (f"no {each!r} in: {finding.message}" for each in lacking(truth, said))
        for name in sorted(EQUAL & case.keys()):
            if (is_so := getattr(finding, name)) != (case[name] or None):
                yield f"{name} is {is_so}"
        call = self.attack.filled(case.get("call", ""), case)
        if call not in (line := self._line(finding)):
            yield f"its call is {line}"
        if "remedy" in case and (finding.cure.name if finding.cure else "") != case["remedy"]:
            yield f"its cure is {finding.cure}"
        if "count" in case and (finding.steps is None or finding.steps.count != case["count"]):
            yield f"its steps are {finding.steps}"

    def _line(self, finding: Finding) -> str:
        """Return the source line of the call that a finding cites; empty if it cites none."""
        lines = self.attack.scene(self.case).lstrip("\n").splitlines()
        _, _, number = (finding.site or "").partition(":")
        return lines[int(number) - 1] if number else ""


def attacks() -> dict[str, Attack]:
    """Return all attacks, by file and name."""
    return dict(chain.from_iterable(map(_attacks_of, sorted(FOLDER.glob("*.toml")))))


def _attacks_of(path: Path) -> Iterator[tuple[str, Attack]]:
    entries = tomllib.loads(path.read_text(encoding="utf-8"))
    pieces = entries.pop("pieces", {})
    own = {"code", "script", "says", "silent"}
    for name, entry in entries.items():
        given, about = ({k: v for k, v in entry.items() if k in keys} for keys in (own, ABOUT))
        names = {k: v for k, v in entry.items() if k not in own | ABOUT}
        yield f"{path.stem}/{name}", Attack(**given, names=pieces | names, about=about)


def _told(finding: Finding) -> tuple[object, ...]:
    return finding.message, finding.advice, finding.steps, finding.site


def _told_but_numbers(finding: Finding) -> tuple[object, ...]:
    return re.sub(r"\d+", "#", finding.message), finding.advice, finding.site


def _short(case: Case) -> str:
    return ", ".join(
        f"{name}={str(value)[:40]!r}" for name, value in case.items() if name != "words"
    )

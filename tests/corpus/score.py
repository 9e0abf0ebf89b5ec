"""How well `drop analyze` diagnoses scripts whose faults are known.

    python tests/corpus/score.py            # all scripts, on all processors, and a tenth of them
    python tests/corpus/score.py --tenth    # only the tenth that the tests score by default
    python tests/corpus/score.py NAME …     # only these: print what falls short
    python tests/corpus/score.py --mujoco   # the scripts in mujoco/, likewise
    python tests/corpus/score.py --attacks  # the scenes in attacks/ (`attacks.py`)

`truth.toml` says of each script what its author asks, and of the findings:

    cause    one of these codes must be among the first two findings; its message and advice hold
             all `words` (patterns) and `numbers` (value, tolerance), it is about `joint`.
             A pattern is sought in "MESSAGE ADVICE [LEVEL]"; what is proposed begins "to try: ".
             A script whose cause is empty is right as it is, and is to be left in peace: a note
             at most.
    true     codes that may be said beside it
    false    codes, or "code: pattern" of the same text, that must not be said
    fix      whether the script shows the cure: `python NAME.py fix`

A finding's `reason` counts like its code. A code that the truth does not mention is unjudged; among
the first two findings it is noise. `whole.json` and `tenth.json` hold the scores, which may only
rise: this program writes them again where they have risen, and refuses where they have fallen.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER.parent))  # run as a program, it finds the tests' modules

from drop_physics.explain.jsonable import jsonable  # noqa: E402
from drop_physics.recording.reader import read  # noqa: E402
from drop_physics.stages.analyze import analysis_of  # noqa: E402
from drop_physics.stages.record import record_script  # noqa: E402
from drop_physics.workers import cores  # noqa: E402
from forked import fork_scripts  # noqa: E402

fork_scripts()

FIRST = 2
"""Number of findings that a reader is assumed to look at."""
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")

Finding = Mapping[str, Any]
"""A finding in the JSON output of `drop analyze`."""


@dataclass(frozen=True)
class Truth:
    """The known correct diagnosis of a script."""

    asked: str
    truth: str
    cause: list[str]
    words: list[str] = field(default_factory=list)
    numbers: list[tuple[float, float]] = field(default_factory=list)
    joint: str | None = None
    true: list[str] = field(default_factory=list)
    false: list[str] = field(default_factory=list)
    fix: bool = False

    @property
    def codes(self) -> set[str]:
        """The finding codes that the truth makes a statement about."""
        return {*self.cause, *self.true, *(entry.partition(":")[0] for entry in self.false)}


@dataclass(frozen=True)
class Verdict:
    """How a script's findings compare with the correct diagnosis."""

    found: bool | None
    """Whether the cause is among the first findings; None for a script without a fault."""
    false: list[str]
    """Codes of false findings."""
    noise: list[str]
    """Codes among the first findings that the truth does not mention; for a script without a fault
    also those of findings graver than a note."""
    unjudged: list[str]
    """All reported codes that the truth does not mention."""

    @property
    def in_peace(self) -> bool:
        """Whether no finding is false or irrelevant."""
        return not self.false and not self.noise


Verdicts = dict[str, Verdict]
"""Verdicts by script name."""


def truths(corpus: Path = FOLDER) -> dict[str, Truth]:
    """Return the correct diagnosis of each script."""
    entries = tomllib.loads((corpus / "truth.toml").read_text(encoding="utf-8"))
    return {name: Truth(**entry) for name, entry in entries.items()}


def findings_of(name: str, corpus: Path = FOLDER) -> list[Finding]:
    """Record and analyze a script in this process, and return its findings, most severe first.

    It is done as `drop analyze --json` does it, but for the layer and the terminal.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        Path(os.devnull).open("w") as nothing,
    ):
        script = shutil.copy(corpus / "scripts" / f"{name}.py", folder)
        recording = Path(folder, "a.rrd")
        record_script(script, out=recording, stdout=nothing.fileno())
        return [jsonable(finding) for finding in analysis_of(read(recording)).findings]


def _called(finding: Finding) -> set[str]:
    """Return a finding's code and, if it has one, its reason."""
    return {finding["code"], finding.get("reason") or finding["code"]}


def _text(finding: Finding) -> str:
    advice = f"{'to try: ' * finding['proposed']}{finding['advice'] or ''}"
    return f"{finding['message']} {advice} [{finding['level']}]"


def lacking(truth: Truth, finding: Finding) -> list[str]:
    """Return the required words, numbers and joint that a finding lacks."""
    text = _text(finding)
    numbers = [float(number) for number in NUMBER.findall(text.replace(",", ""))]
    if finding["effect"] and finding["effect"]["value"] is not None:
        numbers.append(finding["effect"]["value"])
    lack = [word for word in truth.words if not re.search(word, text, re.IGNORECASE | re.DOTALL)]
    lack += [
        str(value)
        for value, tolerance in truth.numbers
        if not any(abs(number - value) <= tolerance * value for number in numbers)
    ]
    if truth.joint not in (None, finding["joint"]):
        lack.append(str(truth.joint))
    return lack


def _is_false(truth: Truth, finding: Finding) -> bool:
    entries = (entry.partition(": ") for entry in truth.false)
    return any(
        code in _called(finding) and re.search(pattern, _text(finding), re.IGNORECASE | re.DOTALL)
        for code, _, pattern in entries
    )


def judged(truth: Truth, findings: list[Finding]) -> Verdict:
    """Return how a script's findings compare with its truth."""
    right = (finding for finding in findings[:FIRST] if _called(finding) & set(truth.cause))
    unjudged = [not _called(finding) & truth.codes for finding in findings]
    codes = [finding["code"] for finding in findings]
    noise = [code for code, is_so in zip(codes[:FIRST], unjudged, strict=False) if is_so]
    grave = [each["code"] for each in findings if not truth.cause and each["level"] != "note"]
    return Verdict(
        found=any(not lacking(truth, each) for each in right) if truth.cause else None,
        false=[finding["code"] for finding in findings if _is_false(truth, finding)],
        noise=[*dict.fromkeys(noise + grave)],
        unjudged=sorted({code for code, is_so in zip(codes, unjudged, strict=True) if is_so}),
    )


def shortfall(truth: Truth, findings: list[Finding]) -> str:
    """Describe how a script's findings fall short of its truth; empty if they do not."""
    verdict, parts = judged(truth, findings), []
    if verdict.found is False:
        first = [
            each["code"]
            + (f" without {lacking(truth, each)}" if _called(each) & set(truth.cause) else "")
            for each in findings[:FIRST]
        ]
        parts.append(f"wants {' or '.join(truth.cause)}, says {', '.join(first) or 'nothing'}")
    parts += [f"FALSE {', '.join(verdict.false)}"] if verdict.false else []
    parts += [f"noise {', '.join(verdict.noise)}"] if verdict.noise else []
    parts += [f"unjudged {', '.join(verdict.unjudged)}"] if verdict.unjudged else []
    return "; ".join(parts)


def totals(verdicts: Verdicts) -> dict[str, int]:
    """Return the totals over several scripts; those that should decrease are negative."""
    rows = verdicts.values()
    return {
        "causes found": sum(bool(row.found) for row in rows),
        "false statements": -sum(len(row.false) for row in rows),
        "noise": -sum(len(row.noise) for row in rows),
        "right scripts left in peace": sum(row.found is None and row.in_peace for row in rows),
    }


def by_code(verdicts: Verdicts, known: Mapping[str, Truth]) -> dict[str, tuple[int, int, int]]:
    """Count for each code how often it was the cause, was found, and was reported falsely."""
    causes = [(code, row.found) for name, row in verdicts.items() for code in known[name].cause]
    wanted = Counter(code for code, _ in causes)
    found = Counter(code for code, found in causes if found)
    false = Counter(code for row in verdicts.values() for code in row.false)
    return {code: (wanted[code], found[code], false[code]) for code in sorted(wanted | false)}


def fallen(before: Verdicts, now: Verdicts, known: Mapping[str, Truth]) -> list[str]:
    """Return the totals that have decreased, over the scripts that both score files contain."""
    both = before.keys() & now.keys()
    before, now = ({name: each[name] for name in both} for each in (before, now))
    old, new = totals(before), totals(now)
    down = [
        f"{name}: {abs(old[name])} -> {abs(new[name])}" for name in old if new[name] < old[name]
    ]
    codes, new_codes = by_code(before, known), by_code(now, known)
    for code in sorted(codes | new_codes):
        _, found, false = codes.get(code, (0, 0, 0))
        _, now_found, now_false = new_codes.get(code, (0, 0, 0))
        down += [f"{code} found: {found} -> {now_found}"] if now_found < found else []
        down += [f"{code} false: {false} -> {now_false}"] if now_false > false else []
    return down


def read_scores(path: Path) -> Verdicts:
    """Read the verdicts from a score file."""
    held = json.loads(path.read_text(encoding="utf-8"))
    return {name: Verdict(**row) for name, row in held["scripts"].items()}


def write_scores(path: Path, verdicts: Verdicts) -> None:
    """Write a score file; its `entries` are the totals since the first version."""
    entries = json.loads(path.read_text(encoding="utf-8"))["entries"] if path.exists() else []
    entry = {"scripts": len(verdicts)} | {k: abs(v) for k, v in totals(verdicts).items()}
    entries += [entry] if entries[-1:] != [entry] else []
    rows = ",\n".join(
        f"  {json.dumps(name)}: {json.dumps(asdict(row))}" for name, row in verdicts.items()
    )
    past = ",\n".join(f"  {json.dumps(each)}" for each in entries)
    text = f'{{\n "entries": [\n{past}\n ],\n "scripts": {{\n{rows}\n }}\n}}\n'
    path.write_text(text, encoding="utf-8")


def all_findings(names: Iterable[str], corpus: Path = FOLDER) -> dict[str, list[Finding]]:
    """Record and analyze scripts in parallel on all processors."""
    names, spawn = list(names), multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(cores(), len(names)), mp_context=spawn) as pool:
        found = pool.map(findings_of, names, [corpus] * len(names))
        return dict(zip(names, found, strict=True))


def print_scores(verdicts: Verdicts, known: Mapping[str, Truth]) -> None:
    """Print the totals, and the counts for each code."""
    figures, rows = totals(verdicts), verdicts.values()
    causes, right = (sum((row.found is None) is is_so for row in rows) for is_so in (False, True))
    of = {"causes found": f" of {causes}", "right scripts left in peace": f" of {right}"}
    print()
    for name, figure in figures.items():
        print(f"{name:28}{abs(figure):4}{of.get(name, '')}")
    print(f"\n{'code':28}{'cause':>6}{'found':>6}{'false':>6}")
    for code, (wanted, found, false) in by_code(verdicts, known).items():
        print(f"{code:28}{wanted:6}{found:6}{false:6}")
    codes = Counter(code for row in rows for code in row.unjudged)
    print(f"\nunjudged: {', '.join(f'{code} {n}' for code, n in sorted(codes.items())) or 'none'}")


def print_attacks(names: list[str]) -> None:
    """Print how attacks fall short of their requirements, for all or for named attacks."""
    import attacks

    known = attacks.attacks()
    for name in names or known:
        with tempfile.TemporaryDirectory() as folder:
            for short in known[name].shortfalls(Path(folder)):
                print(f"{name:30}{short}")


def main() -> None:
    """Score scripts, print their shortfalls, and save scores that have improved."""
    ask = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    ask.add_argument("names", nargs="*", metavar="NAME", help="score only these scripts")
    ask.add_argument("--tenth", action="store_true", help="score the tests' tenth")
    ask.add_argument("--mujoco", action="store_true", help="score MuJoCo's scripts")
    ask.add_argument("--attacks", action="store_true", help="score scenes that attack a code")
    asked = ask.parse_args()
    if asked.attacks:
        print_attacks(asked.names)
        return
    corpus = FOLDER / "mujoco" if asked.mujoco else FOLDER
    known, files = truths(corpus), {name: corpus / f"{name}.json" for name in ("tenth", "whole")}
    tenth = list(read_scores(files["tenth"]))
    names = asked.names or (tenth if asked.tenth else list(known))
    said = all_findings(names, corpus)
    for name in names:
        if short := shortfall(known[name], said[name]):
            print(f"{name:30}{short}")
    verdicts = {name: judged(known[name], said[name]) for name in names}
    print_scores(verdicts, known)
    if asked.names:
        return
    scored = {"tenth": tenth} | ({} if asked.tenth else {"whole": names})
    now = {which: {name: verdicts[name] for name in of} for which, of in scored.items()}
    down = [
        line for which, of in now.items() for line in fallen(read_scores(files[which]), of, known)
    ]
    if down:
        sys.exit("\nthe scores have fallen, and are not written: " + "; ".join(down))
    for which, of in now.items():
        write_scores(files[which], of)


if __name__ == "__main__":
    main()

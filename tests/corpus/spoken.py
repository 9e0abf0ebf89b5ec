"""Which rows of the rules no script makes speak: each gets a script from real life, or goes.

python tests/corpus/spoken.py    # runs both corpora and all attacks, on all processors
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a program, it finds the tests' modules

import attacks
from drop_physics.rules.answer import Finding, Scene
from drop_physics.rules.every import RULES
from drop_physics.rules.rows import Case, SayingRow
from drop_physics.workers import cores
from score import FOLDER, findings_of, truths

CORPORA = FOLDER, FOLDER / "mujoco"


def row_names(*, engines: tuple[str, ...] | None = None) -> dict[str, SayingRow]:
    """Return the rows of all rules, or of those for exactly these engines, by rule and place."""
    return {
        f"{rule.code} {rule.matches.__name__} {place}": row
        for rule in RULES
        for place, row in enumerate(rule.told)
        if engines in (None, row.engines or rule.engines)
    }


@contextmanager
def spoken() -> Iterator[list[SayingRow]]:
    """Collect the rows that are reported inside the block."""
    rows, say = list[SayingRow](), SayingRow.finding

    def said(row: SayingRow, case: Case, scene: Scene, plain: Finding) -> Finding | None:
        found = say(row, case, scene, plain)
        rows.extend([] if found is None else [row])
        return found

    SayingRow.finding = said  # type: ignore[method-assign]
    try:
        yield rows
    finally:
        SayingRow.finding = say  # type: ignore[method-assign]


def spoken_by(corpus: Path | None, name: str) -> set[str]:
    """Return the names of the rows that a script makes speak; without a corpus, an attack."""
    with spoken() as rows, tempfile.TemporaryDirectory() as folder:
        if corpus is None:
            list(attacks.attacks()[name].shortfalls(Path(folder)))
        else:
            findings_of(name, corpus)
    return {name for name, row in row_names().items() if row in rows}


def main() -> None:
    """Print the rows that no script makes speak."""
    jobs = [(corpus, name) for corpus in CORPORA for name in truths(corpus)]
    with ProcessPoolExecutor(cores(), mp_context=multiprocessing.get_context("spawn")) as pool:
        found = set[str]().union(*pool.map(spoken_by, *zip(*jobs, strict=True)))
    for name in attacks.attacks():  # these keep a process of their own, which a pool would wait for
        found |= spoken_by(None, name)
    silent = [name for name in row_names() if name not in found]
    print(f"{len(silent)} of {len(row_names())} rows are never said", *silent, sep="\n")


if __name__ == "__main__":
    main()

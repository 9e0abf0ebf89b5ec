"""Print how well the sums of kinematic trees close, for docs/validation.md (a script).

Per kind of scene of `test_tree_law`, over all robots: the largest remainder of a step over its
largest term, and in brackets over the largest entry of a term alone (`Sum.largest` counts single
forces too).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pybullet as p
import test_tree_law as scenes
from drop_physics.physics.impulses import Sum
from trees import engine, run

MODES = ("default", "off", "position", "velocity", "torque", "pd")
TESTS: dict[str, tuple[Callable[..., None], tuple[object, ...]]] = {
    "free": (scenes.test_free_motion_closes, ()),
    **{mode: (scenes.test_a_robot_on_a_floor_that_may_touch_itself_closes, (mode,))
       for mode in MODES},
    "pushed": (scenes.test_any_robot_that_is_pushed_closes, (False,)),
    "pushed, asked before": (scenes.test_any_robot_that_is_pushed_closes, (True,)),
    "rolling": (scenes.test_any_robot_with_rolling_and_spinning_friction_closes, ()),
    "late timestep": (scenes.test_any_robot_whose_timestep_is_set_after_its_motors_closes, ()),
    "fixed": (scenes.test_any_robot_that_holds_a_cube_closes, (p.JOINT_FIXED,)),
    "point to point": (scenes.test_any_robot_that_holds_a_cube_closes, (p.JOINT_POINT2POINT,)),
}  # fmt: skip
SMALL = 1e-6
"""Terms below this [N s, N m s] are often rounding errors of forces along the joints' axes."""


def sums(test: Callable[..., None], *how: object) -> list[Sum]:
    """Return the sums that a test asserts to close."""
    kept: list[Sum] = []
    scenes.closes = kept.append
    test(*how)
    return kept


def remainders(found: Sum) -> tuple[float, float]:
    """Return the largest remainder relative to a step's scale, and to its terms alone."""
    entries = np.max([np.abs(term).max(axis=1) for term in found.terms.values()], axis=0)
    large = entries > SMALL
    alone = np.abs(found.remainder).max(axis=1)[large] / entries[large]
    return float(found.unexplained.max()), float(alone.max(initial=0.0))


def by_cause(file: str) -> Iterator[tuple[str, float]]:
    """Yield how well energy and momentum close over 1,000 steps, relative to the largest cause."""
    with engine(floor=True):
        watched = scenes.robot(file, height_m=0.6)
        run([watched], 1000, scenes.driven(watched, "position"))
        found = watched.sum()
    totals = [values.sum() for values in found.energy_j().values()]
    yield "energy", abs(found.energy_change_j().sum() - sum(totals)) / max(map(abs, totals))
    if not watched.law.tree.fixed:
        moved = [values.sum(axis=0) for values in found.momentum_kg_m_s().values()]
        left = np.abs(found.momentum_change_kg_m_s().sum(axis=0) - sum(moved)).max()
        yield "momentum", float(left / max(np.abs(value).max() for value in moved))


def main() -> None:
    """Print the worst robot of each kind of scene."""
    found: dict[str, list[tuple[float, float, str]]] = {}
    for file in (*scenes.ROBOTS, *scenes.MORE):
        for scene, (test, how) in TESTS.items():
            both = np.max([remainders(one) for one in sums(test, file, *how)], axis=0)
            found.setdefault(scene, []).append((*both, file))
        for scene, off in by_cause(file):
            found.setdefault(scene, []).append((off, off, file))
    for scene, rows in found.items():
        worst, _, file = max(rows)
        alone, middle = max(row[1] for row in rows), np.median([row[0] for row in rows])
        print(f"\n{scene} | {len(rows)} | {middle:.0e} | {worst:.0e} ({alone:.0e}) | {file}")


if __name__ == "__main__":
    main()

"""Contact, bounces and rest: the recording compared with Bullet's contact law.

Contact is measured for any body; causes are given only if the contact law covers the drop (see
`covers`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

import numpy as np

from drop_physics.drop.case import DropCase
from drop_physics.drop.phases import Phases
from drop_physics.drop.posture import flat_height_m, stands, tilt_rad
from drop_physics.drop.results import Bounce, Contact, Landing, Rest, RestTerms
from drop_physics.drop.samples import DropSamples
from drop_physics.drop.touchdowns import Touchdown
from drop_physics.physics import theory
from drop_physics.physics.laws.bullet import contact as bullet_contact
from drop_physics.physics.laws.bullet.contact import (
    CONTACT_ERP,
    CONTACT_SLOP_M,
    RESTITUTION_THRESHOLD_M_S,
)
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.physics.laws.mujoco import contact as mujoco_contact

LONGEST_THROW_S = 3600.0
REPRODUCED = 1e-3
"""Share of the approach speed by which a rebound may deviate from the contact law and still count
as explained: ten times the largest measured effect of the solver's early stop."""
ROUNDED = 1e-9
"""Share of the approach speed by which two ways to compute a rebound may differ."""
AT_REST_M_S, LAST = 1e-4, 10
"""Largest speed [m/s], in this many last samples, at which a predicted path counts as at rest."""
SUNK_M = 1e-9
"""Largest deviation [m] between a resting body and the closed form of its contact, up to which the
closed form explains the rest height."""


# -- when it lands --------------------------------------------------------------------------------


def find_landing(case: DropCase) -> Landing | None:
    """Return the theoretical landing; None if the body never reaches the floor.

    This is computed only for a body that reaches the floor as released: without spin, or a ball.
    """
    floor_m, fall = case.floor_height_m, case.fall
    turns = any(case.scenario.spin_rad_s) and not case.is_ball
    if floor_m is None or turns or not case.is_rigid or not case.scenario.stepped:
        return None
    free_s = theory.impact_time_free(fall, floor_m)
    if not case.starts_above or free_s is None:
        return None
    # An oblique throw is integrated, which is useless over days: thrown up in almost no gravity.
    oblique = fall.drag.quadratic_per_m > 0 and any(fall.velocity_m_s[:2])
    endless = oblique and free_s > LONGEST_THROW_S
    damped_s = None if endless else theory.impact_time_damped(fall, floor_m)
    # Drag takes no body further sideways than free fall.
    reach_m = np.array(fall.velocity_m_s) * free_s
    if not case.over_floor(reach_m[None]):
        return None
    return Landing(time_free_fall_s=free_s, time_damped_s=damped_s)


# -- the contact law ------------------------------------------------------------------------------


def covers(case: DropCase) -> bool:
    """Return whether the contact law covers this drop: one box that lands and stays flat.

    The box must be released flat, above the floor, without spin or sideways velocity, with the
    centre of mass above its base, and contact must not be a spring.
    """
    sideways = any((*case.scenario.velocity_m_s[:2], *case.scenario.spin_rad_s))
    floor_m = case.floor_height_m
    return (
        isinstance(case.law, BulletLaw)
        and case.is_box
        and not case.is_springy
        and case.scenario.stepped
        and floor_m is not None
        and case.engine.pair_restitution is not None
        and not sideways
        and float(tilt_rad(case, case.start.orientation)[0]) < 1e-9
        and stands(case)
        and case.starts_above
    )


def _path(
    case: DropCase, height_m: float, velocity_m_s: float, *, contact_erp: float | None = None
) -> Iterator[tuple[float, float]]:
    """Yield heights [m] and vertical velocities [m/s] predicted by the contact law.

    `contact_erp` replaces the scenario's.
    """
    assert isinstance(case.law, BulletLaw)
    assert case.floor_height_m is not None
    assert case.engine.pair_restitution is not None
    return bullet_contact.flat_drop(
        case.law,
        height_m=height_m,
        velocity_m_s=velocity_m_s,
        rest_height_m=case.floor_height_m,
        restitution=case.engine.pair_restitution,
        contact_erp=_contact_erp(case) if contact_erp is None else contact_erp,
        restitution_threshold_m_s=restitution_threshold_m_s(case),
    )


def _fall(case: DropCase, *, contact_erp: float | None = None) -> Iterator[tuple[float, float]]:
    """Yield predicted heights and velocities from the release to the recording's end."""
    path = _path(case, case.fall.height_m, case.fall.velocity_m_s[2], contact_erp=contact_erp)
    return itertools.islice(path, case.samples)


class ContactLaw:
    """Compares the recorded heights with those of the contact law, as samples are added."""

    def __init__(self, case: DropCase) -> None:
        self._deepest_m = _deepest_m(case)
        self._fall = _fall(case) if covers(case) else None
        self._tail = np.empty((0, 2))
        self._contact = Contact(0.0, 0)

    @property
    def applies(self) -> bool:
        """True if the law covers the drop, and predicts that the body stays above mid-floor."""
        return self._fall is not None

    def add(self, part: DropSamples, flat: int) -> None:
        """Add further samples, the first `flat` of which lie flat."""
        if self._fall is None:
            return
        numbers = itertools.chain.from_iterable(itertools.islice(self._fall, len(part)))
        path = np.fromiter(numbers, np.float64, 2 * len(part)).reshape(-1, 2)
        self._tail = np.vstack((self._tail, path))[-LAST:]
        if not path[:, 0].min() > self._deepest_m:
            self._fall = None
            return
        off_m = part.height_m[:flat] - path[:flat, 0]
        worst = int(np.argmax(np.abs(off_m))) if flat else 0
        if flat and (not part.first or abs(off_m[worst]) > self._contact.max_deviation_m):
            self._contact = Contact(float(abs(off_m[worst])), part.first + worst)

    def contact(self, phases: Phases, tumbled_step: int | None) -> Contact | None:
        """Return how far recorded heights deviate from the contact law while the body is flat."""
        if phases.contact_step is None or tumbled_step == phases.contact_step:
            return None
        return self._contact if self.applies else None

    @property
    def end(self) -> tuple[float, float]:
        """Predicted height at the last sample [m], and largest speed in the last samples [m/s]."""
        return float(self._tail[-1, 0]), float(np.abs(self._tail[:, 1]).max())


def _deepest_m(case: DropCase) -> float:
    """Return the lowest valid height of the centre [m]: deeper, the floor would push down."""
    return (case.floor_height_m or 0.0) - bullet_contact.FLOOR_HALF_THICKNESS_M


def _contact_erp(case: DropCase) -> float:
    asked = case.scenario.contact_erp
    return CONTACT_ERP if asked is None else asked


def restitution_threshold_m_s(case: DropCase) -> float:
    """Return the approach speed below which restitution has no effect [m/s]."""
    asked = case.scenario.restitution_threshold_m_s
    return RESTITUTION_THRESHOLD_M_S if asked is None else asked


# -- bounces --------------------------------------------------------------------------------------


def find_bounces(
    case: DropCase, touchdowns: list[Touchdown], tumbled_step: int | None
) -> list[Bounce]:
    """Return the rebounds from the floor, with the predictions from restitution alone."""
    floor_m = case.floor_height_m
    if not case.is_rigid or floor_m is None or case.fall.gravity_m_s2 >= 0:
        return []
    leaving = [touchdown for touchdown in touchdowns if touchdown.leaves]
    uncorrected_m = _uncorrected_m(case, floor_m) if leaving and covers(case) else []
    bounces = []
    plain = True
    for number, touchdown in enumerate(leaving, start=1):
        plain = plain and _is_plain(case, touchdown, tumbled_step)
        # Where the recording ends on the way up, there is no apex to compare.
        whole = plain and (touchdown.returned or case.end.velocity_m_s[0, 2] <= 0)
        bounces.append(
            Bounce(
                step=touchdown.first - 1,
                approach_m_s=touchdown.approach_m_s,
                rebound_m_s=touchdown.pushed_m_s,
                effective_restitution=touchdown.pushed_m_s / touchdown.approach_m_s
                if plain
                else None,
                apex_m=touchdown.highest_m - floor_m,
                predicted_apex_m=_predicted_apex_m(case, number) if whole else None,
                uncorrected_apex_m=uncorrected_m[number - 1]
                if whole and number <= len(uncorrected_m)
                else None,
                correction_m_s=_correction_m_s(case, touchdown) if plain else None,
            )
        )
    return bounces


def _is_plain(case: DropCase, touchdown: Touchdown, tumbled_step: int | None) -> bool:
    """Return whether restitution alone predicts the rebound: for a ball, or a box landing flat."""
    if case.is_springy or (tumbled_step is not None and touchdown.last >= tumbled_step):
        return False
    return case.is_ball or (case.is_box and touchdown.stays_flat)


def _predicted_apex_m(case: DropCase, number: int) -> float | None:
    """Return e^(2k) h for the k-th bounce [m]; a throw counts as a drop from v²/2g higher."""
    if case.engine.pair_restitution is None or case.floor_height_m is None:
        return None
    fall = case.fall
    thrown_m = fall.velocity_m_s[2] ** 2 / (-2 * fall.gravity_m_s2)
    drop_m = fall.height_m - case.floor_height_m + thrown_m
    return float(bullet_contact.rebound_heights(drop_m, case.engine.pair_restitution, number)[-1])


def _uncorrected_m(case: DropCase, floor_m: float) -> list[float]:
    """Return the predicted apexes without position correction [m], if the law applies."""
    deepest_m, lowest_m = _deepest_m(case), np.inf

    def heights_m() -> Iterator[float]:
        nonlocal lowest_m
        for height_m, _ in _fall(case, contact_erp=0.0):
            lowest_m = min(lowest_m, height_m)
            yield height_m

    apexes_m = [*_apexes(heights_m(), floor_m)]
    return apexes_m if lowest_m > deepest_m else []


def _apexes(heights_m: Iterable[float], floor_m: float) -> Iterator[float]:
    """Yield the apex above the floor each time that a path leaves it [m].

    A path that ends on its way up has no apex.
    """
    was_below, top_m, rises = False, None, False
    for height_m in heights_m:
        if height_m <= floor_m:
            if top_m is not None:
                yield top_m - floor_m
            was_below, top_m = True, None
        elif was_below:
            rises = top_m is None or height_m > top_m
            top_m = height_m if top_m is None else max(top_m, height_m)
    if top_m is not None and not rises:
        yield top_m - floor_m


def _correction_m_s(case: DropCase, touchdown: Touchdown) -> float | None:
    """Return the speed that position correction adds to restitution × approach [m/s].

    The speed is computed by the contact law from the recorded sample before the touchdown. None if
    contact pushes for more than one step, if the law does not reproduce the recorded rebound, or if
    its rebound without position correction is not restitution × approach: a body that is less deep
    in the floor than the slop is slowed by the rest of the slop.
    """
    height_m = float(touchdown.before.position_m[0, 2])
    if not covers(case) or height_m <= _deepest_m(case) or touchdown.pushed != touchdown.first:
        return None

    def rebound_m_s(contact_erp: float | None = None) -> float:
        falls_m_s = float(touchdown.before.velocity_m_s[0, 2])
        _, (_, after_m_s) = itertools.islice(
            _path(case, height_m, falls_m_s, contact_erp=contact_erp), 2
        )
        return after_m_s

    corrected_m_s = rebound_m_s()
    if abs(touchdown.pushed_m_s - corrected_m_s) > REPRODUCED * touchdown.approach_m_s:
        return None
    asked_m_s = bullet_contact.rebound_speed(
        -touchdown.approach_m_s,
        case.engine.pair_restitution or 0.0,
        threshold_m_s=restitution_threshold_m_s(case),
    )
    if abs(rebound_m_s(0.0) - asked_m_s) > ROUNDED * touchdown.approach_m_s:
        return None
    return corrected_m_s - asked_m_s


# -- rest -----------------------------------------------------------------------------------------


def find_rest(
    case: DropCase, phases: Phases, tumbled_step: int | None, law: ContactLaw
) -> Rest | None:
    """Return the rest position, and the terms of its deviation from the expected height."""
    if not phases.lies:
        return None
    last_m, expected_m = float(case.end.height_m[0]), flat_height_m(case)
    if expected_m is None:
        return Rest(last_m, None, None, phases.rest_step, None)
    terms = None
    if law.applies and tumbled_step is None:
        terms = _rest_terms(case, law, last_m, expected_m)
    error_m = last_m - expected_m
    return Rest(last_m, expected_m, error_m, phases.rest_step, terms, _sinks_m(case, error_m))


def _rest_terms(
    case: DropCase, law: ContactLaw, last_m: float, expected_m: float
) -> RestTerms | None:
    """Return the terms of the error at rest; None if the predicted path does not come to rest."""
    law_end_m, fastest_m_s = law.end
    if fastest_m_s >= AT_REST_M_S or _bounces_on(case) or not _contact_erp(case) > 0:
        return None
    return RestTerms(
        slop=-CONTACT_SLOP_M,
        solver=last_m - law_end_m,
        settling=law_end_m - (expected_m - CONTACT_SLOP_M),
    )


def _sinks_m(case: DropCase, error_m: float) -> float | None:
    """Return the depth of a body at rest in soft contact [m]; None if it rests elsewhere."""
    engine, gravity_m_s2 = case.engine, -case.fall.gravity_m_s2
    points, depth_m = int(case.end.contact_points[0]), None
    if gravity_m_s2 > 0 and points and engine.solref is not None and engine.solimp is not None:
        time_constant_s, ratio = engine.solref
        if time_constant_s > 0:
            time_constant_s = max(time_constant_s, mujoco_contact.shortest_s(case.timestep_s))
        depth_m = mujoco_contact.rest_depth_m(
            gravity_m_s2, points, (time_constant_s, ratio), engine.solimp
        )
    if depth_m is None or abs(error_m + depth_m) > SUNK_M:
        return None
    return depth_m


def _bounces_on(case: DropCase) -> bool:
    """Return whether restitution acts even on the speed that gravity adds in one step.

    The body then comes to rest above the slop, where each bounce just compensates a step of
    gravity.
    """
    assert isinstance(case.law, BulletLaw)
    falls_m_s = bullet_contact.free_velocity(case.law, (0.0, 0.0, 0.0))
    threshold_m_s = restitution_threshold_m_s(case)
    restitution = case.engine.pair_restitution or 0.0
    return bullet_contact.rebound_speed(falls_m_s, restitution, threshold_m_s=threshold_m_s) != 0

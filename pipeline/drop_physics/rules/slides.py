"""`slides`, `creeps`: what rests on something, or is held by it, slips fast, or slowly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.steps import BodySteps, Steps
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.rule import Match, Said, Worst, side_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import (
    CREEPS_M_S,
    CREEPS_STEADY,
    CREEPS_STEPS,
    CREEPS_STRAIGHT,
    CREEPS_USED,
    FROM_REST,
    GRIPPED,
    LANDS_M_S,
    NO_FORCE,
    SLIDES,
    SLIPS_M,
    SLIPS_M_S,
    SLIPS_SHARE,
    SLIPS_STEPS,
    TREMBLES_M_S,
)

Float64 = NDArray[np.float64]
Rows = NDArray[np.intp]


@side_rule("slides", "asked", consecutive=True, argument="lateralFriction", least_count=SLIPS_STEPS)
def slides(pair: PairColumns) -> Match:
    """Gravity and the support's acceleration, no push, ask more of friction than it can give."""
    return _slips(pair, pair.slip_m_s > SLIPS_M_S)


@slides.counts
def _(runs: Runs, scene: Scene) -> Float64:
    beyond = (runs.until_against > runs.until_available) & (runs.slid >= SLIDES * runs.moved)
    slips = beyond | ((runs.turning > runs.held) & (runs.held > 0))
    rested = runs.began <= FROM_REST * runs.size
    touches = runs.normal > NO_FORCE * np.linalg.norm(runs.needed, axis=1)
    sizes_m = np.array([size_m(scene.body(number)) for number in runs.keys[:, 0].tolist()])
    far = runs.slid > np.maximum(SLIPS_M, SLIPS_SHARE * sizes_m)
    return np.where(far & rested & slips & touches, runs.slid, 0.0)


@slides.says
def _(worst: Worst) -> Said:
    cure = None
    seconds, pressed = worst.until_time, worst.until_normal
    if worst.until_against <= worst.until_available:
        message = Message(
            "{body} turns in the grip of {on}, {slid:.3g} m at the contact: friction there "
            "gives at most {held:.3g} N m about it, and its weight beside it takes "
            "{turning:.3g} N m"
        )
        advice = Message("grip it at its centre of mass, or with more force or friction")
    else:
        factor = max(2.0, 2 * worst.until_against / max(worst.until_available, 1e-300))
        cure = Cure("friction", worst.body, float(f"{factor:.3g}"))
        message = Message(
            "{body} slides {slid:.3g} m on {on}: friction there gives at most "
            "{available:.3g} N (coefficient {given:.3g}), staying takes {needed:.3g} N "
            "({wanted:.3g})"
        )
        advice = Message(
            "raise the product of both bodies' coefficients well above {wanted:.3g} with "
            "p.changeDynamics(…, lateralFriction=…), or press them together with more force"
        )
    return Said(
        message=message,
        values={
            "on": worst.other,
            "held": worst.held / worst.time,
            "turning": worst.turning / worst.time,
            "available": worst.until_available / seconds,
            "given": worst.until_available / pressed,
            "needed": worst.until_against / seconds,
            "wanted": worst.until_against / pressed,
        },
        advice=advice,
        cure=cure,
        effect=Effect(worst.slid, "m"),
        share=worst.slid / worst.body_size_m,
    )


@side_rule(
    "creeps", "model", consecutive=True, argument="lateralFriction", least_count=CREEPS_STEPS
)
def creeps(pair: PairColumns) -> Match:
    """The solver ends before contacts are at rest: once it changes little, or has no iterations."""
    return _slips(pair, (pair.slip_m_s > TREMBLES_M_S) & (pair.slip_m_s < CREEPS_M_S))


@creeps.counts
def _(runs: Runs, _: Scene) -> Float64:
    needed, went = (np.linalg.norm(each, axis=1) for each in (runs.needed, runs.way))
    holds = (went > SLIPS_M) & (runs.size * runs.time < CREEPS_STEADY * went)
    holds &= np.minimum(runs.slid, went) > CREEPS_STRAIGHT * np.maximum(runs.slid, runs.moved)
    holds &= np.maximum(needed, np.abs(runs.used)) < CREEPS_USED * runs.available
    return np.where(holds, runs.slid, 0.0)


@creeps.says
def _(worst: Worst) -> Said:
    went, seconds = float(np.linalg.norm(worst.way)), worst.time
    return Said(
        message=Message(
            "{body} creeps {moved:.3g} mm on {on} in {time:.3g} s: friction there could give "
            "{available:.3g} N and staying takes {needed:.3g} N, but the solver ends before the "
            "contact is at rest"
        ),
        values={
            "moved": went * 1e3,
            "on": worst.other,
            "available": worst.available / seconds,
            "needed": float(np.linalg.norm(worst.needed)) / seconds,
        },
        advice=Message(
            "call p.setPhysicsEngineParameter(solverResidualThreshold=0, numSolverIterations=500)"
        ),
        cure=Cure(
            "solver", given={"solverResidualThreshold": 0, "numSolverIterations": 500}, value=500.0
        ),
        effect=Effect(went, "m"),
        share=went / worst.body_size_m,
    )


def _slips(pair: PairColumns, slips: NDArray[np.bool_]) -> Match:
    """Return the steps in which single bodies slip on others, and nothing else pushes them.

    Sums: of slip [m] and way of the centre [m], time [s]; normal, available, used impulse [N s],
    and that against the slip which moving with the support takes; in a grip the moment about the
    contact of that, and what friction can give of it [N m s]. Those of forces in a grip leave out
    the steps in which it closes.
    """
    free = np.isin(pair.body, [each.body.number for each in _free_bodies(pair.scene)])
    rows = np.flatnonzero(slips & free & (pair.normal_n > 0) & (pair.body != pair.other))
    asked, others, pushed, way, arm = _acting(pair, rows)
    line, normal = pair.line[rows], pair.normal_n[rows]
    along = _dot(asked, line)
    needed, way = asked - along[:, None] * line, way - _dot(way, line)[:, None] * line
    # What is held from both sides hangs back, whoever else carries it; elsewhere that is a push.
    gripped = lengths(pair.pressed_n[rows]) < GRIPPED * normal
    alone = (pushed <= NO_FORCE * normal) & (gripped | (others <= NO_FORCE * normal))
    alone &= pair.one_line[rows] & pair.own("explained")[rows]
    # What lies on one side presses with what it needs, on average: step by step it chatters.
    pressed = np.where(gripped, normal, np.abs(along))
    steady = ~gripped | (np.abs(pair.approach_m_s[rows]) < LANDS_M_S)
    moved = lengths(way)
    needs = lengths(needed).clip(1e-300)
    turning, held = np.zeros((2, len(rows)))
    if gripped.any():
        turning = gripped * np.abs(_dot(np.cross(arm, asked), line))
        held = gripped * pair.own("held_n_m")[rows]
    dt = pair.timestep_s[rows]
    forces = {
        "time": np.ones(len(rows)),
        "normal": pressed,
        "available": pair.available_n[rows] / normal * pressed,
        "used": pair.sign * _dot(pair.tangential_n[rows], needed) / needs,
        "against": -_dot(needed, way) / moved.clip(1e-300),
        "turning": turning,
        "held": held,
    }
    sums = {name: each * steady * dt for name, each in forces.items()}
    sums |= {"slid": pair.slip_m_s[rows] * dt, "moved": moved * dt, "way": way * dt[:, None]}
    sums["needed"] = needed * (steady * dt)[:, None]
    firsts = {"began": pair.began_slip_m_s[rows]}
    bodies, step, placing = pair.body[rows], pair.step[rows], pair.scene.placing
    begins = placing.moved(bodies, step) | placing.restored(bodies, step)
    return Match(rows, pair.slip_m_s[rows], sums=sums, firsts=firsts, holds=alone, begins=begins)


def _is_free(steps: Steps) -> bool:
    """Return whether steps are those of single bodies, and a sum."""
    return steps.law.tree.size == 6 and bool(steps.terms)


def _free_bodies(scene: Scene) -> list[BodySteps]:
    """Return the steps of single bodies in the latest piece."""
    free = (batch.bodies for batch, _ in scene.batches if _is_free(batch.whole))
    return [each for bodies in free for each in bodies]


def _acting(pair: PairColumns, rows: Rows) -> tuple[Float64, ...]:
    """Return what a body's weight, and moving with its support, ask of the contact, (n, 3) [N].

    Then what other bodies do to it, and pushes and constraints, shape (n,) [N]; how its centre
    moves past the support [m/s], and where it is from the contact [m], shape (n, 3). NaN where the
    sum says nothing.
    """
    asked, way, arm = np.full((3, len(rows), 3), np.nan)
    others, pushed = np.full((2, len(rows)), np.nan)
    began, ended, goes = (
        pair.others(f"{name}_m_s")[rows] for name in ("began", "carried", "ended")
    )
    step, dt = pair.step[rows], pair.timestep_s[rows, None]
    support = ended - began
    # Between steps calls may give it another velocity.
    placed = pair.scene.placing.moved(pair.other[rows], step)
    if placed.any():
        last = pair.before(rows)
        now = np.flatnonzero((last >= 0) & placed)
        support[now] += began[now] - ended[last[now]]
    for steps, its, at in pair.of_bodies(rows):
        if not _is_free(steps):
            continue
        terms = {
            name: steps.terms[name][at, 3:6] / dt[its]
            for name in ("contacts", "constraints", "applied")
        }
        weight = support[its] / dt[its] - steps.reported.gravity_m_s2[at]
        asked[its] = steps.law.tree.masses_kg[0] * weight
        touched = terms["contacts"] - pair.sign * pair.force_n[rows[its]]
        others[its] = lengths(touched)
        pushed[its] = lengths(terms["constraints"] + terms["applied"])
        way[its] = steps.after.velocity[at, 3:6] - goes[its]
        arm[its] = steps.before.position_m[at] - pair.own("centre_m")[rows[its]]
    return asked, others, pushed, way, arm


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("ni,ni->n", a, b))

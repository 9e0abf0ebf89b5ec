"""Rules about masses and inertias in model files, and how PyBullet changes them."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import replace

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.joints import AT_LIMIT
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import BASE, RATES, Tree
from drop_physics.rules.answer import and_more
from drop_physics.rules.arguments import site_of
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.inputs import FileInertia, Inputs
from drop_physics.rules.joint import link_of
from drop_physics.rules.rows import Case, Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule, input_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import (
    LITTLE_MASS,
    OTHER_INERTIA,
    OTHER_INERTIA_MATTERS,
    TURNS_RAD_S,
    WITHOUT_INERTIAL_KG,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, FileLink
from drop_physics.trace.history import Seen
from drop_physics.trace.properties import link_reached

FROM_FILE = 2
"""`URDF_USE_INERTIA_FROM_FILE`, one of the flags of `loadURDF`."""


def moving_links(tree: Tree) -> list[int]:
    """Return the links that can move, as only their masses matter."""
    moves = [not tree.fixed]
    for link, parent in enumerate(tree.parents):
        moves.append(moves[parent + 1] or RATES[tree.joints[link]] > 0)
    return [link for link in range(BASE, tree.links) if moves[link + 1]]


def told_links(body: Body, tree: Tree) -> dict[int, FileLink]:
    """Return the file's data of the links that can move, as far as it has any."""
    told, links = {each.name: each for each in body.asked.links}, body.links
    return {link: told[links[link + 1]] for link in moving_links(tree) if links[link + 1] in told}


def _came(inputs: Inputs, seen: Seen) -> Iterator[tuple[Body, Tree]]:
    """Yield each body with its kinematic tree, as it was first loaded."""
    for number, life in inputs.first_lives.items():
        body = seen.bodies[number]
        if len(body.links) == life.tree.links + 1:
            yield body, life.tree


@input_rule("no-inertial", "asked")
def no_inertial(inputs: Inputs, asked: AskedOfBodies, seen: Seen) -> Iterator[Case]:
    """PyBullet gives a movable link without `<inertial>` a mass of 1 kg."""
    for body, tree in _came(inputs, seen):
        masses_kg = {link: float(tree.masses_kg[link + 1]) for link in moving_links(tree)}
        links = [
            link
            for link, each in told_links(body, tree).items()
            if np.isnan(each.mass_kg) and masses_kg[link] == WITHOUT_INERTIAL_KG
        ]
        if links:
            total_kg = sum(masses_kg.values())
            yield Case(
                subject=body,
                call=asked.load(body),
                values={
                    "link": body.links[links[0] + 1],
                    "links": links,
                    "more": and_more(len(links)),
                    "mass": float(len(links)),
                    "total": total_kg,
                    "part": len(links) / total_kg,
                },
            )


no_inertial.rows(
    SayingRow(when=lambda part: part < LITTLE_MASS, level="note"),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{link}{more} has no <inertial> in the file, so PyBullet gives it 1 kg: {mass:g} of "
            "the {total:.3g} kg that move"
        ),
        cure=Remedy("inertial", "body", given={"links": "links"}),
        effect="mass",
        unit="kg",
        share="part",
    ),
)


@input_rule("impossible-inertia", "model")
def impossible_inertia(inputs: Inputs, asked: AskedOfBodies, seen: Seen) -> Iterator[Case]:
    """The two smaller moments of inertia of a link add up to less than the largest."""
    for body, tree in _came(inputs, seen):
        told = told_links(body, tree)
        for link in moving_links(tree):
            moments = sorted(tree.inertias_kg_m2[link + 1].tolist())
            mass_kg = float(tree.masses_kg[link + 1])
            zeroed = moments[2] == 0 and link in told and bool(body.flags & FROM_FILE)
            if zeroed:
                written = _written(body, told[link])
                moments = moments if written is None else np.linalg.eigvalsh(written).tolist()
            if not mass_kg > 0 or _is_possible(moments):
                continue
            low, middle, high = moments
            values = {"low": low, "middle": middle, "high": high, "zeroed": zeroed}
            values |= {"link": body.links[link + 1], "mass": mass_kg}
            yield Case(subject=body, call=asked.load(body), values=values)
            break


impossible_inertia.rows(
    SayingRow(
        when=lambda zeroed: zeroed,
        says=Message(
            "the file gives {link} of {body} moments of inertia of {low:.3g}, {middle:.3g} "
            "and {high:.3g} kg m² with {mass:.3g} kg, and PyBullet sets them to 0"
        ),
    ),
    SayingRow(
        says=Message(
            "{link} of {body} has moments of inertia of {low:.3g}, {middle:.3g} and {high:.3g} "
            "kg m² with {mass:.3g} kg"
        )
    ),
    like=SayingRow(
        advice=Message(
            "no body has it: the two smaller moments add up to the largest or more; "
            "correct <inertia>, or give p.changeDynamics another localInertiaDiagonal"
        )
    ),
)


def _is_possible(moments: Sequence[float]) -> bool:
    """Return whether three moments of inertia, the largest last, are physically possible."""
    return moments[0] + moments[1] >= moments[2] * (1 - 1e-6)


# -- inertia-from-shape ---------------------------------------------------------------------------


@body_rule("inertia-from-shape", "note", subject=1, proposes=True)
def inertia_from_shape(bodies: BodyColumns, inputs: Inputs) -> Match | None:
    """PyBullet computes inertias from shapes; the file's would change a rotation."""
    found = {body.body.number: _other(inputs, body) for body in bodies.batch.bodies}
    whole = all(len(each.added) == bodies.law.tree.size for each in found.values())
    if not bodies.terms or not whole or not any(each.added.any() for each in found.values()):
        return None
    more = bodies.of_each(lambda each: found[each.body.number].added)
    used = bodies.of_each(lambda each: found[each.body.number].used)
    changes = np.abs(bodies.after.velocity - bodies.before.velocity)
    missing, first = changes * np.abs(more), bodies.law.tree.first_rate
    largest = np.max([changes * used, *map(np.abs, bodies.terms.values())], axis=0)
    # A motor that has force left, or a constraint, leads its joint as fast with any inertia.
    limit = bodies.whole.substeps * np.concatenate(
        [body.asked.impulse for body in bodies.batch.bodies]
    )
    motors = np.abs(bodies.terms["motors"][:, first:])
    missing[:, first:][(limit > 0) & (motors < AT_LIMIT * limit)] = 0
    missing[bodies.terms["constraints"] != 0] = 0
    real = np.isfinite(missing) & np.isfinite(largest)
    return Match(
        more != 0,
        np.ones(more.shape),
        {"ratio": 1 + more / used},
        sums={"missing": np.where(real, missing, 0), "acting": np.where(real, largest, 0)},
        most={"fastest": np.nan_to_num(np.abs(bodies.after.velocity), posinf=0)},
    )


@inertia_from_shape.counts
def _(missing: Float64, acting: Float64, fastest: Float64) -> Float64:
    shares = np.minimum(missing / np.maximum(acting, 1e-300), 1.0)
    return np.where((fastest > TURNS_RAD_S) & (shares > OTHER_INERTIA_MATTERS), shares, 0.0)


@inertia_from_shape.notes
def _(
    inputs: Inputs,
    asked: AskedOfBodies,
    subject: Body,
    keys: list[int],
    among: int,
    ratio: float,
    missing: float,
    acting: float,
) -> Noted:
    row = keys[1] - 6 * subject.base_moves
    of_file = inputs.first_lives[subject.number].of_file
    changed = None if of_file is None else of_file.changed
    loaded, joint = asked.loaded(subject), None
    says = Message(
        "with the file's <inertia>, the moment of inertia of {body} about {axis}{more} would "
        "be {written} times what PyBullet uses: {why}"
    )
    if row >= 0:
        joint = subject.joints[link_of(subject, row)].name
        says = Message(
            "the file's <inertia> gives {joint}{more} {written} times the inertia that PyBullet "
            "uses: {why}"
        )
    return {
        "says": says,
        "kind": joint is None,
        "axis": "xyz"[row % 3],
        "joint": joint,
        "more": and_more(among),
        "written": f"{ratio:.2f}" if ratio < 1e3 else f"{ratio:.2g}",
        "changed": changed,
        "level": "model" if abs(np.log10(ratio)) > 1 else None,
        "part": min(missing / acting, 1.0),
        "called": loaded if changed is None else site_of(changed),
    }


inertia_from_shape.rows(
    SayingRow(
        when=lambda changed: changed is not None,
        why=Message("p.changeDynamics(mass=…) computes it anew from the collision shape"),
        advice=Message("give p.changeDynamics localInertiaDiagonal together with the mass"),
    ),
    SayingRow(
        when=lambda subject: not subject.collisions,
        why=Message("PyBullet computes it from the collision shape, and there is none"),
        advice=Message("load it with {call}"),
        cure=Remedy("inertia-from-file", "body"),
    ),
    SayingRow(
        why=Message("PyBullet computes it from the collision shape"),
        advice=Message("load it with {call}"),
        cure=Remedy("inertia-from-file", "body"),
    ),
    like=SayingRow(effect="ratio", unit="1", share="part", site="called"),
)


def _other(inputs: Inputs, steps: BodySteps) -> FileInertia:
    """Compare the inertias in a body's file with those of the engine; once per body."""
    body, life = steps.body, inputs.first_lives[steps.body.number]
    if life.of_file is None:
        inertias, masses = set[int](), dict[int, Call]()
        for use in inputs.of(Act.SET_PROPERTY):
            if use.body is not None and use.body.number == body.number:
                link = link_reached(use.first.values)
                if "localInertiaDiagonal" in use.low:
                    inertias.add(link)
                elif "mass" in use.low:
                    masses[link] = use.last
        changed: Call | None = None
        used = np.diagonal(mass_matrix(kinematics(life.tree, life.before))[0])
        added = np.zeros(life.tree.size)
        if len(body.links) == life.tree.links + 1 and "planar" not in steps.config.reasons:
            tree = replace(life.tree, inertias_kg_m2=_of_file(body, life.tree, inertias, masses))
            added = np.nan_to_num(np.diagonal(mass_matrix(kinematics(tree, life.before))[0]) - used)
            changed = next(iter(masses.values()), None)
        differs = (np.abs(added) > OTHER_INERTIA * used) & (added > -used)
        life.of_file = FileInertia(np.where(differs, added, 0), used, changed)
    return life.of_file


def _of_file(body: Body, tree: Tree, inertias: Container[int], masses: Container[int]) -> Float64:
    """Return the file's principal moments of inertia, shape (links + 1, 3); nan if unknown.

    The moments are about the principal axes of the file's inertia, which the engine uses, too.
    """
    moments_kg_m2 = tree.inertias_kg_m2.copy()
    for link, told in told_links(body, tree).items():
        if link in inertias or (body.flags & FROM_FILE and link not in masses):
            continue
        written, mass_kg = _written(body, told), float(tree.masses_kg[link + 1])
        # The flag gives it 1 kg m² where the file says nothing.
        own = np.full(3, np.nan) if np.isnan(told.mass_kg) else moments_kg_m2[link + 1]
        if written is not None and _is_possible(sorted(np.linalg.eigvalsh(written))):
            # With another mass it is spread as the file's own.
            own = np.diag(written) * (mass_kg / told.mass_kg if link in masses else 1)
            # No mass is farther off than the shape is long.
            if not 0 < np.trace(written) <= 2 * told.mass_kg * _extent_m(body, link) ** 2:
                own = np.full(3, np.nan)
        moments_kg_m2[link + 1] = own
    return moments_kg_m2


def _written(body: Body, told: FileLink) -> Float64 | None:
    """Return the inertia matrix in a file [kg m²], shape (3, 3); None if incomplete."""
    if not told.mass_kg > 0 or len(told.inertia_kg_m2) != 6:
        return None
    xx, xy, xz, yy, yz, zz = told.inertia_kg_m2
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * np.square(body.asked.scale)
    return moments if np.isfinite(moments).all() else None


def _extent_m(body: Body, link: int) -> float:
    """Return the diagonal of a box around a link's shapes, or around the whole body [m]."""
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))
    shapes = [collision.link for collision in body.collisions]
    its = boxes[[link + 1]] if link in shapes else boxes[[shape + 1 for shape in shapes]]
    if not len(its):
        return np.inf
    return float(np.linalg.norm(its[:, 1].max(axis=0) - its[:, 0].min(axis=0)))

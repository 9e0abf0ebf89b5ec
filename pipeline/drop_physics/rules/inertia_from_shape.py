"""Why something turns too fast or too slowly: its inertia is the shape's, not the file's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import Driven
from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.physics.columns import rotation
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.rotations import matrix
from drop_physics.physics.tree import BASE, Tree
from drop_physics.rules.answer import Cure, Effect, Finding, Scene, and_more
from drop_physics.rules.arguments import given, site_of
from drop_physics.rules.first_look import FirstLook, told_links
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, Collision, FileLink
from drop_physics.trace.properties import link_reached

Float64 = NDArray[np.float64]

OFF = 0.1
"""By which share an inertia may differ."""
MATTERS = 0.02
"""Of the impulses on a degree of freedom: less than that the other inertia changes nothing."""
TURNS_RAD_S = 0.1
"""What never turns faster rests, or rocks a little."""
ROOM = 2.0
"""How much larger an inertia may be than with all mass where its collision shape ends: a link may
be larger than what is touched of it, but not by much."""
AXES = "x", "y", "z"


class InertiaFromShape(FirstLook):
    """Compares the file's inertia with the one that is used, and weighs what that changed."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._inertias: set[tuple[int, int]] = set()
        """Bodies and links whose inertia calls set."""
        self._masses: dict[tuple[int, int], Call] = {}
        """The last call that set a mass and no inertia."""
        self._other: dict[int, OtherInertia] = {}

    def see(self) -> None:
        """Look at new bodies, and at all steps of those whose inertia is another."""
        for call, body in self.scene.calls_of(Act.SET_PROPERTY):
            key = body.number, link_reached(call.values)
            if given(call, "localInertiaDiagonal"):
                self._inertias.add(key)
            elif given(call, "mass"):
                self._masses[key] = call
        super().see()
        for judged, steps in self.scene.stretches():
            if judged.body.number in self._other:
                driven = [each for each in self.scene.driven() if each.steps is steps]
                self._other[judged.body.number].weigh(driven, steps)

    def look(self, body: Body, steps: Steps) -> None:
        """Compare the links whose inertia no call set."""
        tree = steps.law.tree
        if not tree.size or "planar" in steps.epoch.reasons:
            return
        links = {
            link: each
            for link, each in told_links(body, tree).items()
            if (body.number, link) not in self._inertias
        }
        masses = {link: call for link in links if (call := self._masses.get((body.number, link)))}
        links |= {link: _of_mass(links[link], float(tree.masses_kg[link + 1])) for link in masses}
        kin = kinematics(tree, steps.before.at(np.array([0])))
        other = other_inertia(self.scene, body, kin, links)
        if other is not None:
            other.changed = next(iter(masses.values()), None)
            other.loaded = self.scene.asked.loaded(body)
            self._other[body.number] = other

    def findings(self) -> Iterator[Finding]:
        """Yield what the file's inertia would have changed of each body."""
        yield from filter(None, (each.finding() for each in self._other.values()))


@dataclass(eq=False)
class OtherInertia:
    """A body to which its file gives another inertia, and what that would have changed."""

    body: Body
    rows: Sequence[int]
    """Degrees of freedom whose inertia differs."""
    joints: Sequence[str | None]
    """Name of the joint of each; None of the base."""
    ratios: Float64
    """The file's over the one that is used."""
    more: Float64
    """The file's minus the one that is used [kg m²]."""
    missing: Float64
    """The sum of what the file's would have taken besides [N m s]."""
    acting: Float64
    """The sum of the largest impulse of each step, or of what was taken if that is more."""
    fastest_rad_s: Float64
    changed: Call | None = None
    """What set the mass."""
    loaded: str | None = None

    def weigh(self, found: Sequence[Driven], steps: Steps) -> None:
        """Add what the file's inertia would have taken in some steps.

        A motor that has force left leads its joint as fast with any inertia.
        """
        rows, first = [*self.rows], steps.law.tree.first_rate
        if not len(steps) or not steps.terms or steps.law.tree.size <= max(rows):
            return
        changes = np.abs(steps.after.velocity - steps.before.velocity)[:, rows]
        missing, own = changes * np.abs(self.more), changes * np.abs(self.more / (self.ratios - 1))
        for driven in found:
            led = (driven.asked.impulse > 0) & ~driven.at_limit
            for k, row in enumerate(rows):
                if row >= first:
                    missing[led[:, row - first], k] = 0
        largest = np.max([own, *(np.abs(each[:, rows]) for each in steps.terms.values())], axis=0)
        fastest = np.nan_to_num(np.abs(steps.after.velocity[:, rows]), posinf=0).max(axis=0)
        self.fastest_rad_s = np.maximum(self.fastest_rad_s, fastest)
        real = np.isfinite(missing) & np.isfinite(largest)
        self.missing = self.missing + np.where(real, missing, 0).sum(axis=0)
        self.acting = self.acting + np.where(real, largest, 0).sum(axis=0)

    def finding(self) -> Finding | None:
        """Return what there is to say."""
        shares = self.missing / np.maximum(self.acting, 1e-300)
        shares *= self.fastest_rad_s > TURNS_RAD_S
        row, count = int(shares.argmax()), int((shares > MATTERS).sum())
        if not count:
            return None
        joint, body = self.joints[row], self.body
        cause = Message("PyBullet computes it from the collision shape")
        if not body.collisions:
            cause = Message("PyBullet computes it from the collision shape, and there is none")
        advice = Message("load it with flags=p.URDF_USE_INERTIA_FROM_FILE")
        if self.changed is not None:
            cause = Message("p.changeDynamics(mass=…) computes it anew from the collision shape")
            advice = Message("give p.changeDynamics localInertiaDiagonal together with the mass")
        cure = Cure("inertia-from-file", body.label) if self.changed is None else None
        values = {"more": and_more(count), "ratio": self.ratios[row], "cause": cause}
        message = Message(
            "with the file's <inertia>, the moment of inertia of {body} about {axis}{more} would "
            "be {ratio:.2f} times what PyBullet uses: {cause}",
            body=body.label,
            axis=AXES[self.rows[row] % 3],
            **values,
        )
        if joint is not None:
            message = Message(
                "with the file's <inertia>, {joint}{more} would move {ratio:.2f} times the inertia "
                "that PyBullet uses: {cause}",
                joint=joint,
                **values,
            )
        return Finding(
            code="inertia-from-shape",
            level="model",
            message=message,
            advice=advice,
            cure=cure,
            body=body.label,
            joint=joint,
            effect=Effect(float(self.ratios[row]), "1"),
            share=min(float(shares[row]), 1.0),
            site=self.loaded if self.changed is None else site_of(self.changed),
        )


def other_inertia(
    scene: Scene, body: Body, kin: Kinematics, of_file: Mapping[int, FileLink]
) -> OtherInertia | None:
    """Compare M with the file's inertias of some links and with those that are used."""
    tree, more, too_large = kin.tree, {}, set()
    for link, each in of_file.items():
        moments = _of_file(body, each)
        if moments is not None and np.trace(moments) > _most_kg_m2(body, link, each):
            too_large.add(link)
            continue
        used_kg_m2 = np.sort(tree.inertias_kg_m2[link + 1])
        # PyBullet does not scale an inertia that it takes from the file.
        unscaled = moments is not None and np.allclose(
            np.linalg.eigvalsh(moments) / np.square(body.asked.scale), used_kg_m2, rtol=1e-6, atol=0
        )
        if moments is not None and not unscaled:
            turned = kin.matrix(link)[0]
            used = turned @ np.diag(tree.inertias_kg_m2[link + 1]) @ turned.T
            # The file's axes are those that the engine takes where it takes the shape's.
            more[link] = _in_world(scene, body, link, each, turned, moments) - used
    diagonal = np.diagonal(mass_matrix(kin)[0])
    added = {
        row: float(sum(axis @ more[link] @ axis for link in links & more.keys()))
        for row, axis, links in _axes(kin)
        if not links & too_large
    }
    rows = [
        row
        for row, each in added.items()
        if abs(each) > OFF * diagonal[row] and each > -diagonal[row]
    ]
    if not rows:
        return None
    kg_m2, none = np.array([added[row] for row in rows]), np.zeros(len(rows))
    ratios = 1 + kg_m2 / diagonal[rows]
    return OtherInertia(
        body, rows, [_joint(body, tree, row) for row in rows], ratios, kg_m2, none, none, none
    )


def _of_mass(told: FileLink, mass_kg: float) -> FileLink:
    """Return a link of a file with another mass, spread as its own is."""
    share = mass_kg / told.mass_kg if told.mass_kg > 0 else 0.0
    moments = tuple(share * each for each in told.inertia_kg_m2)
    return replace(told, mass_kg=mass_kg, inertia_kg_m2=moments)


def _joint(body: Body, tree: Tree, row: int) -> str | None:
    link = next((k for k, rate in enumerate(tree.rates) if rate.start <= row < rate.stop), None)
    return None if link is None else body.joints[link].name


def _axes(kin: Kinematics) -> Iterator[tuple[int, Float64, set[int]]]:
    """Yield the degrees of freedom that turn links: row, axis, and these links."""
    tree = kin.tree
    if not tree.fixed:
        for row in range(3):
            yield row, np.eye(3)[row], {*range(BASE, tree.links)}
    for link, joint in enumerate(tree.joints):
        if joint in ("revolute", "spherical"):
            turned = {each for each in range(tree.links) if link in tree.branch(each)}
            for k, axis in enumerate(kin.axes[link]):
                yield tree.rates[link].start + k, axis[:, 0], turned


def _of_file(body: Body, told: FileLink) -> Float64 | None:
    """Return the file's inertia, shape (3, 3), if a body can have it."""
    if not told.mass_kg > 0 or len(told.inertia_kg_m2) != 6:
        return None
    xx, xy, xz, yy, yz, zz = told.inertia_kg_m2
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * np.square(body.asked.scale)
    if not np.isfinite(moments).all():
        return None
    low, middle, high = np.linalg.eigvalsh(moments)
    return moments if low > 0 and low + middle >= high * (1 - 1e-6) else None


def _most_kg_m2(body: Body, link: int, told: FileLink) -> float:
    """Return the largest trace of an inertia that a link of its mass and shape can have.

    It is 2 Σ m r², and no mass is farther off than the shape, or than the whole body is long.
    """
    reach_m = max((_reach_m(each) for each in body.collisions if each.link == link), default=np.inf)
    return ROOM * 2 * told.mass_kg * min(reach_m, _extent_m(body)) ** 2


def _extent_m(body: Body) -> float:
    """Return the diagonal of the box around all shapes of a body; infinite if it has none."""
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))[[each.link + 1 for each in body.collisions]]
    if not len(boxes):
        return np.inf
    return float(np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)))


def _reach_m(shape: Collision) -> float:
    """Return how far a shape reaches from its link's centre of mass, or more."""
    if shape.hull_m:
        return float(np.linalg.norm(np.reshape(shape.hull_m, (-1, 3)), axis=1).max())
    size = np.array(shape.size_m)
    reach = {
        "box": np.linalg.norm(size) / 2,
        "sphere": size[:1].sum(),
        "cylinder": np.hypot(size[0] / 2, size[-1]),
        "capsule": size[0] / 2 + size[-1],
    }
    return float(np.linalg.norm(shape.position_m) + reach.get(shape.kind, np.inf))


def _in_world(
    scene: Scene, body: Body, link: int, told: FileLink, turned: Float64, moments: Float64
) -> Float64:
    """Return the file's inertia in world axes; `turned` are those of the one that is used."""
    first = next(each for each in scene.seen.dynamics if each.body.number == body.number)
    used = matrix(first.reported["inertial_orientation"][link + 1].tolist())
    roll, pitch, yaw = (np.array(told.rpy_rad) / 2).tolist()
    about = [
        np.array([np.sin(half) * (axis == k) for k in range(3)] + [np.cos(half)])
        for axis, half in enumerate((roll, pitch, yaw))
    ]
    x, y, z = (rotation(each[:, None])[:, :, 0] for each in about)
    axes = turned @ used.T @ (z @ y @ x)
    return np.asarray(axes @ moments @ axes.T)

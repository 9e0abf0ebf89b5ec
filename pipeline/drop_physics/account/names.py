"""Names of bodies, links and terms in the text of the account's rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from drop_physics.account.terms import CONTACT, DRAG, FRICTION, GAP, GIVEN, HELD, RATE, Term
from drop_physics.arrays import Float64
from drop_physics.explain.cause_names import cause_in_words
from drop_physics.messages import Message
from drop_physics.physics.rotations import rotate
from drop_physics.trace.events import Body, Dynamics

WORDS = {
    "motors": Message("motor"),
    "stops": Message("joint limit"),
    "integrator": Message("integrator"),
    "applied": Message("applied force"),
    "friction loss": Message("joint friction"),
    "clamp": Message("the engine's speed limit"),
    "contacts": Message("other contacts"),
    "constraints": Message("constraint"),
    "own inertia": Message("own inertia"),
    "remainder": Message("unexplained"),
    GIVEN: Message("torque as given"),
}
"""Names of causes in a row, where they differ from those in the energy balance."""


class Names:
    """Looks up the names of a recording's bodies, links and terms."""

    def __init__(self, bodies: Mapping[int, Body], dynamics: Sequence[Dynamics] = ()) -> None:
        self._bodies = bodies
        self._reported = {each.body.number: each.reported for each in dynamics}
        self._counts = Counter(body.short for body in bodies.values())

    def body(self, number: int) -> str:
        """Return the name of a body, with its id if the name is shared; `world` for None."""
        body = self._bodies.get(number)
        if body is None:
            return Message("world")
        return body.short if self._counts[body.short] == 1 else body.label

    def label(self, number: int) -> str | None:
        """Return the label of a body; None for no body."""
        return self._bodies[number].label if number in self._bodies else None

    def link(self, number: int, link: int) -> str:
        """Return the name of a link, or the name of its body if the body has no other link."""
        body = self._bodies.get(number)
        if body is None or len(body.links) == 1 or not -1 <= link < len(body.links) - 1:
            return self.body(number)
        return body.links[link + 1]

    def pair(self, key: tuple[int, int, int, int]) -> tuple[str, str]:
        """Return the names of two links, given the ids of their bodies and the links."""
        a, b, i, j = key
        return str(self.link(a, i)), str(self.link(b, j))

    def partner(self, number: int, term: Term) -> str:
        """Return the name of the other body in a contact."""
        assert term.other is not None
        assert term.other_link is not None
        name = self.link(term.other, term.other_link)
        many = term.other in self._bodies and len(self._bodies[term.other].links) > 1
        if term.other == number or not many or name == self.body(term.other):
            return name
        return f"{self.body(term.other)}.{name}"

    def rate(self, body: Body, joint_rate: int) -> str:
        """Return the name of a joint's degree of freedom: the joint, with an axis if it has three.

        A spherical joint's rates are about the principal axes of the link's inertia; the name has
        the nearest of the link's own axes.
        """
        for joint, place in zip(body.joints, body.rates, strict=True):
            if place.start <= joint_rate < place.stop:
                if place.stop - place.start == 1:
                    return joint.name
                frames = self._reported.get(body.number, {}).get("inertial_orientation")
                axis = np.eye(3)[[joint_rate - place.start]]
                if frames is not None and np.isfinite(frames[joint.link + 1]).all():
                    axis = rotate(frames[[joint.link + 1]], axis)
                return f"{joint.name}[{main_axis(axis[0])}]"
        return self.body(body.number)

    def base_frame(self, number: int) -> Float64 | None:
        """Return the orientation of a base's inertia relative to the base, by body id, shape (4,).

        None if the orientation is not recorded.
        """
        frames = self._reported.get(number, {}).get("inertial_orientation")
        return None if frames is None else np.asarray(frames[0])

    def term(self, body: Body, term: Term, first_rate: int) -> str:
        """Return the name of a term, with the body that exerts it, if any."""
        if term.cause in (CONTACT, FRICTION):
            assert term.link is not None
            own, other = self.link(body.number, term.link), self.partner(body.number, term)
            if len(body.links) > 1:
                other = f"{own}/{other}"
            if term.cause == CONTACT:
                return Message("contact {other}", other=other)
            return Message("friction {other}", other=other)
        if term.cause == DRAG and term.name:
            return Message("acceleration of other parts")
        if term.cause == DRAG and term.rate is None:
            return Message("acceleration of its base")
        if term.cause == DRAG:
            assert term.rate is not None
            if term.rate < first_rate:
                return Message("acceleration of its base")
            return Message("acceleration of {joint}", joint=self.rate(body, term.rate - first_rate))
        if term.cause == HELD and term.other is not None:
            return Message("constraint to {partner}", partner=self.partner(body.number, term))
        if term.cause == HELD and term.name:
            return Message("constraint {name}", name=term.name)
        if term.cause == GAP:
            return Message("kp × gap")
        if term.cause == RATE:
            return Message("kv × rate")
        return WORDS.get(term.cause) or cause_in_words(term.cause)


def main_axis(direction: Float64) -> str:
    """Return the signed axis nearest to a direction: `x`, `-z`."""
    most = int(np.argmax(np.abs(direction)))
    return ("-" if direction[most] < 0 else "") + "xyz"[most]

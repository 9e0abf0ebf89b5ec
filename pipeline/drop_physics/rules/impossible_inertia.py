"""Why a body tumbles oddly: it has moments of inertia that no body can have."""

from __future__ import annotations

from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.rules.answer import Finding
from drop_physics.rules.first_look import FirstLook, moving_links
from drop_physics.trace.events import Body

IMPOSSIBLE = Message(
    "no body has it: the two smaller moments add up to the largest or more; correct <inertia>, or "
    "give p.changeDynamics another localInertiaDiagonal"
)


class ImpossibleInertia(FirstLook):
    """The two smaller moments of a body add up to the largest or more."""

    def look(self, body: Body, steps: Steps) -> None:
        """Note the first link that has others."""
        tree = steps.law.tree
        for link in moving_links(tree):
            low, middle, high = sorted(tree.inertias_kg_m2[link + 1].tolist())
            if not tree.masses_kg[link + 1] > 0 or low + middle >= high * (1 - 1e-6) > 0:
                continue
            if high == 0 and not any(each.link == link for each in body.collisions):
                continue  # a point
            message = Message(
                "{link} of {body} has moments of inertia of {low:.3g}, {middle:.3g} and {high:.3g} "
                "kg m² with {mass:.3g} kg",
                link=body.links[link + 1],
                body=body.label,
                low=low,
                middle=middle,
                high=high,
                mass=tree.masses_kg[link + 1],
            )
            self.found.append(
                Finding(
                    code="impossible-inertia",
                    level="model",
                    message=message,
                    advice=IMPOSSIBLE,
                    body=body.label,
                    site=self.scene.asked.loaded(body),
                )
            )
            return

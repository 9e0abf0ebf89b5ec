"""Why a robot is heavier than it should be: PyBullet gives a link without `<inertial>` 1 kg."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Finding, and_more
from drop_physics.rules.first_look import FirstLook, moving_links, told_links
from drop_physics.trace.events import Body

WITHOUT_INERTIAL_KG = 1.0
"""What PyBullet gives a link whose file has no `<inertial>`."""


class NoInertial(FirstLook):
    """The root of a fixed base, and what cannot move, weighs nothing."""

    def look(self, body: Body, steps: Steps) -> None:
        """Note the links that can move, of which the file tells no mass."""
        tree = steps.law.tree
        of_file = told_links(body, tree)
        masses_kg = tree.masses_kg[1 + np.array([*of_file], np.int64)]
        links = [
            link
            for (link, each), mass_kg in zip(of_file.items(), masses_kg, strict=True)
            if np.isnan(each.mass_kg) and mass_kg == WITHOUT_INERTIAL_KG
        ]
        if not links:
            return
        total_kg = sum(tree.masses_kg[link + 1] for link in moving_links(tree))
        message = Message(
            "{link}{more} has no <inertial> in the file, so PyBullet gives it 1 kg: {mass:g} of "
            "the {total:.3g} kg that move",
            link=body.links[links[0] + 1],
            more=and_more(len(links)),
            mass=float(len(links)),
            total=total_kg,
        )
        self.found.append(
            Finding(
                code="no-inertial",
                level="asked",
                message=message,
                body=body.label,
                advice=Message(
                    "give the link an <inertial>, or p.changeDynamics(body, {link}, mass=…)",
                    link=links[0],
                ),
                cure=Cure("inertial", body.label, given={"links": links}),
                effect=Effect(float(len(links)), "kg"),
                share=len(links) / total_kg,
                site=self.scene.asked.loaded(body),
            )
        )

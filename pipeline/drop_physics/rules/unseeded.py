"""Random numbers that another run draws differently."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Finding
from drop_physics.rules.engines import ANY


class Unseeded(Answer):
    """Random numbers that another run draws differently."""

    engines = ANY

    def findings(self) -> Iterator[Finding]:
        """Yield where the first was drawn."""
        places = self.scene.seen.unseeded
        if not places:
            return
        where: str = places[0]
        if len(places) > 1:
            where = Message(
                "{place} (the first of {places} places)", place=places[0], places=len(places)
            )
        yield Finding(
            code="unseeded",
            level="repeat",
            site=places[0].rpartition(" at ")[2] or None,
            message=Message("unseeded random numbers are drawn by {where}", where=where),
            advice=Message("seed them in the script, or record it with --seed 0"),
        )

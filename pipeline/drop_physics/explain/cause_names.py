"""Names causes for readers: `gravity`, `joint friction` …, in the reader's language."""

from __future__ import annotations

from drop_physics.messages import Message

CAUSES = {
    "gravity": Message("gravity"),
    "bias": Message("Coriolis and gyroscopic forces"),
    "damping": Message("damping"),
    "joint damping": Message("joint damping"),
    "motors": Message("motors"),
    "applied": Message("applied"),
    "contacts": Message("contact"),
    "rolling": Message("rolling friction"),
    "constraints": Message("constraints"),
    "stops": Message("stops"),
    "set": Message("set"),
    "clamp": Message("velocity limit"),
    "integrator": Message("integrator"),
    "remainder": Message("remainder"),
    "spring": Message("springs"),
    "fluid": Message("fluid"),
    "friction loss": Message("friction loss"),
    "gravity compensation": Message("gravity compensation"),
    "adhesion": Message("adhesion"),
    "passive callback": Message("passive callback"),
    "joint force range": Message("force range of the joint"),
    "solver": Message("solver not converged"),
    "another engine": Message("another engine"),
}
"""Display names of causes that change energy or momentum."""
NAMED_CAUSES = {
    "actuator": Message("actuator {name}"),
    "tendon": Message("tendon {name}"),
}
"""Display names of kinds of causes of which a body may have several."""


def cause_in_words(cause: str) -> Message:
    """Return the name of a cause as a reader sees it."""
    kind, _, name = cause.partition(" ")
    if cause in CAUSES:
        return CAUSES[cause]
    if name and kind in NAMED_CAUSES:
        return Message(NAMED_CAUSES[kind].template, name=name)
    return Message("{cause}", cause=cause)

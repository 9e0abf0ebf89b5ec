"""The values that an engine reports about itself and the bodies of a drop, after set-up.

Values that an engine does not report are None. Damping, contact ERP and the solver's residual are
missing, since PyBullet has no call that returns them. For a btRigidBody, `getDynamicsInfo` returns
mass, inertia, frictions and margin, and leaves restitution, inertial frame and contact stiffness
uninitialised (`processGetDynamicsInfoCommand` of `PhysicsServerCommandProcessor.cpp`). The latter
are read from the same URDF loaded in reduced coordinates, and so are mass and inertia: a
btRigidBody stores their inverses, and 1 / (1 / m) does not always equal m.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self, get_type_hints

Vector = tuple[float, float, float]

LARGEST = 1e60
"""Largest number that is recorded, in any unit, so that energies and sums of squares stay
finite."""


def _reported(description: str, *, default: Any = ...) -> Any:  # noqa: ANN401 - as dataclasses.field
    metadata = {"description": description}
    return field(metadata=metadata) if default is ... else field(default=default, metadata=metadata)


@dataclass(frozen=True, kw_only=True)
class EngineReport:
    """Values reported by the engine; SI units, world axes, None where it reports nothing."""

    timestep_s: float = _reported("as the engine has it")
    substeps: int = _reported("steps that the engine makes of each; 0 means one")
    solver_iterations: int | None = _reported(
        "most iterations of the contact solver per step", default=None
    )
    gravity_m_s2: Vector = _reported("as the engine has it: x, y, z")
    body_name: str = _reported("name of the body in its URDF")
    body_sha256: str = _reported("digest of the URDF")
    body_type: str = _reported(
        "what the body is in the engine; in PyBullet btMultiBody (reduced coordinates) or "
        "btRigidBody (maximal ones)"
    )
    joints: int = _reported("how many the body has; the theory assumes none")
    mass_kg: float = _reported("of the body, all links together")
    link_masses_kg: tuple[float, ...] = _reported("of each link, the base first")
    inertia_kg_m2: Vector = _reported("principal moments of inertia about the centre of mass")
    link_inertias_kg_m2: tuple[float, ...] = _reported(
        "three of each link, the base first, each about its own centre of mass"
    )
    lateral_friction: float | None = _reported("of the body, against sliding", default=None)
    rolling_friction: float | None = _reported("of the body, against rolling", default=None)
    spinning_friction: float | None = _reported(
        "of the body, against spinning in place", default=None
    )
    restitution: float | None = _reported(
        "of the body; a btRigidBody reports none, so that of the same URDF as a btMultiBody",
        default=None,
    )
    contact_stiffness_n_m: float | None = _reported(
        "of a springy contact, as a URDF's <contact> can set it", default=None
    )
    contact_damping_n_s_m: float | None = _reported("of such a contact", default=None)
    collision_margin_m: float | None = _reported("margin around the body's shape", default=None)
    shape: str = _reported("of the body's collision shape: box, sphere, …; compound, or none")
    shape_dimensions_m: tuple[float, ...] = _reported(
        "of that shape, as PyBullet reports them: a box's three edges"
    )
    shape_position_m: Vector | None = _reported(
        "of that shape's centre from the centre of mass, in the body's axes", default=None
    )
    shape_orientation: tuple[float, float, float, float] | None = _reported(
        "of that shape in the body's axes: quaternion x, y, z, w", default=None
    )
    reach_m: float = _reported(
        "how far the corners of the box around the body, or its base, are from its centre"
    )
    rest_height_m: float | None = _reported(
        "height of the centre at which the body, turned as released, touches the floor; "
        "measured by the engine's own collision detection; none without a shape",
        default=None,
    )
    floor_lateral_friction: float | None = _reported("of the floor", default=None)
    floor_restitution: float | None = _reported(
        "of the floor; a bounce uses the product of this and the body's", default=None
    )
    solref: tuple[float, ...] | None = _reported(
        "MuJoCo's time constant and damping ratio of a contact", default=None
    )
    solimp: tuple[float, ...] | None = _reported(
        "MuJoCo's five numbers of how a contact's impedance grows with its depth", default=None
    )
    engine_version: str | None = _reported("of an engine other than PyBullet", default=None)
    pybullet_api: int | None = _reported("PyBullet's API number", default=None)
    pybullet_version: str | None = _reported("of PyBullet", default=None)
    pybullet_build: str | None = _reported("when the engine was compiled", default=None)
    pybullet_wheel: str | None = _reported(
        "kind of wheel that PyBullet was installed from", default=None
    )
    machine: str | None = _reported("kind of processor", default=None)
    drop_version: str | None = _reported("of this project", default=None)
    numpy_version: str | None = _reported("of numpy", default=None)
    python_version: str | None = _reported("of Python", default=None)
    rerun_version: str | None = _reported("of the Rerun SDK", default=None)
    gl_renderer: str | None = _reported("what drew the frames, with `--renderer egl`", default=None)

    @property
    def pair_restitution(self) -> float | None:
        """Combined restitution of body and floor: their product (`btManifoldResult.cpp` 68-71)."""
        if self.restitution is None or self.floor_restitution is None:
            return None
        return self.restitution * self.floor_restitution

    @classmethod
    def says(cls) -> dict[str, str]:
        """Return the description of each value, by name."""
        return {field.name: field.metadata["description"] for field in fields(cls)}

    def as_properties(self) -> dict[str, Any]:
        """Return the values by name, for a recording; values of None are left out."""
        return asdict(self)

    @classmethod
    def from_properties(cls, values: Mapping[str, Any]) -> Self:
        """Return the report stored in a recording's properties.

        Raises
        ------
        TypeError
            If a value is missing.
        """
        hints, read = get_type_hints(cls), dict[str, Any]()
        for name, value in values.items():
            if "tuple" in str(hints.get(name)):
                # A recording returns a list of one element as that element.
                read[name] = tuple(value) if isinstance(value, list) else (value,)
            elif name in hints:
                read[name] = value
        return cls(**read)

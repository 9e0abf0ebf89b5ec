"""Translates engine functions into acts, such as "apply a force", for rules of any engine.

Rules and laws use acts, never names of functions: those occur only here and in the engine's own
room.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

PICTURE = "Renderer.render"
"""Name of a function that renders an image, of which only a digest is recorded."""


class Act(Enum):
    """An act, such as applying a force; the value lists PyBullet's functions for it.

    If scripts write to an engine's memory, the name of the written field is listed instead of a
    function.
    """

    LOAD = ("loadURDF", "loadSDF", "loadMJCF", "loadBullet", "loadSoftBody")
    """Call that loads bodies from a file."""
    MAKE = ("createMultiBody",)
    REMOVE = ("removeBody",)
    CLEAR = ("resetSimulation",)
    """Call that removes everything, and resets the engine."""
    SAVE = ("saveState",)
    RESTORE = ("restoreState",)
    SET_POSE = ("resetBasePositionAndOrientation",)
    SET_VELOCITY = ("resetBaseVelocity",)
    SET_JOINT = ("resetJointState", "resetJointStateMultiDof", "resetJointStatesMultiDof")
    PUSH = ("applyExternalForce",)
    TWIST = ("applyExternalTorque",)
    COMMAND = (
        "setJointMotorControl2",
        "setJointMotorControl",
        "setJointMotorControlArray",
        "setJointMotorControlMultiDof",
        "setJointMotorControlMultiDofArray",
    )
    """Call that sets a joint's motor, or applies a torque to the joint."""
    CONSTRAIN = ("createConstraint",)
    CHANGE_CONSTRAINT = ("changeConstraint",)
    RELEASE = ("removeConstraint",)
    SET_PROPERTY = ("changeDynamics",)
    """Call that sets properties of a body or a link."""
    SET_GRAVITY = ("setGravity",)
    SET_TIMESTEP = ("setTimeStep", "opt.timestep")
    SET_ENGINE = ("setPhysicsEngineParameter",)
    SET_REAL_TIME = ("setRealTimeSimulation",)
    FILTER_PAIR = ("setCollisionFilterPair",)
    FILTER_GROUP = ("setCollisionFilterGroupMask",)
    SOLVE_IK = ("calculateInverseKinematics",)
    """Call that solves inverse kinematics: it returns the joint positions that bring a link to a
    given pose."""
    SOLVE_SEVERAL_IK = ("calculateInverseKinematics2",)
    READ_LINK = ("getLinkState", "getLinkStates")
    READ_VELOCITY = ("getBaseVelocity",)
    READ_PROPERTIES = ("getDynamicsInfo",)
    READ_JOINT = (
        "getJointState",
        "getJointStates",
        "getJointStateMultiDof",
        "getJointStatesMultiDof",
    )
    READ_CONTACTS = ("getContactPoints", "getClosestPoints", "getOverlappingObjects")
    """Call that reads the contacts of bodies."""
    SET_BODY_FORCE = ("xfrc_applied",)
    """Write of a force and a torque on a body, which act until they are set again."""
    SET_JOINT_FORCE = ("qfrc_applied",)
    """Write of a force on a joint, which acts until it is set again."""
    SET_CONTROL = ("ctrl",)
    """Write of actuator controls, which act until they are set again."""
    SET_ACTIVE = ("eq_active",)
    """Write that enables or disables equality constraints, until a reset."""
    SET_STATE = ("qpos",)
    RESET_STATE = (
        "mj_resetData",
        "mj_resetDataKeyframe",
        "mj_resetDataDebug",
        "mj_setState",
        "mj_copyState",
        "mj_copyData",
    )
    """Call that sets the whole state: positions, velocities, controls and forces."""
    SET_MASS = ("body_mass",)
    """Write of masses in a model."""
    SET_DERIVED = ("body_invweight0", "mj_setConst")
    """Call that recomputes the constants that a model derives from its masses."""
    OTHER = ()

    @property
    def function(self) -> str:
        """The first engine function of the act, which messages name."""
        functions: tuple[str, ...] = self.value
        return functions[0]


ACTS: Mapping[str, Act] = {function: act for act in Act for function in act.value}
"""The act of each function, by the function's name."""
LOADS_KEYFRAME = "mj_resetDataKeyframe"
"""Function that loads a keyframe, with its controls."""
PUSHES = Act.PUSH, Act.TWIST
MAKES = Act.LOAD, Act.MAKE
FILTERS = Act.FILTER_PAIR, Act.FILTER_GROUP
CONSTRAINS = Act.CONSTRAIN, Act.CHANGE_CONSTRAINT
SETS_TIMESTEP = Act.SET_TIMESTEP, Act.SET_ENGINE


def act_of(function: str) -> Act:
    """Return the act of a function's calls."""
    return ACTS.get(function, Act.OTHER)

"""Classifies each pybullet function: whether it steps, changes, reads or does none of these.

A test compares this list with pybullet's functions. A function of another version, which is not
listed, counts as one that changes the simulation: its calls are recorded.
"""

from __future__ import annotations

ROLES: dict[str, str] = {
    # The simulation.
    "connects": "connect",
    "disconnects": "disconnect",
    "steps": "stepSimulation",
    "resets": "resetSimulation",
    # What changes it.
    "commands joints": "setJointMotorControl setJointMotorControl2 setJointMotorControlArray "
    "setJointMotorControlMultiDof setJointMotorControlMultiDofArray",
    "pushes": "applyExternalForce applyExternalTorque",
    "makes bodies": "loadURDF loadSDF loadMJCF loadBullet loadSoftBody createMultiBody "
    "unsupportedChangeScaling",
    "removes bodies": "removeBody executePluginCommand unloadPlugin loadPlugin",
    "moves a body": "resetBasePositionAndOrientation resetBaseVelocity resetJointState "
    "resetJointStateMultiDof resetJointStatesMultiDof",
    "moves all": "restoreState executePluginCommand",
    "sets properties": "changeDynamics",
    "sets the engine": "setGravity setTimeStep setPhysicsEngineParameter setDefaultContactERP "
    "setRealTimeSimulation setInternalSimFlags loadBullet loadSDF loadMJCF",
    "makes constraints": "createConstraint",
    "removes constraints": "removeConstraint",
    "sets constraints": "changeConstraint",
    "makes shapes": "createCollisionShape createCollisionShapeArray",
    "recolours": "changeVisualShape resetVisualShapeData",
    "sets what is touched": "setCollisionFilterPair setCollisionFilterGroupMask "
    "removeCollisionShape performCollisionDetection",
    "sets soft bodies": "createSoftBodyAnchor resetMeshData",
    "sets sensors": "enableJointForceTorqueSensor",
    "makes looks": "createVisualShape createVisualShapeArray loadTexture changeTexture",
    "keeps states": "saveState removeState",
    "asks for joints": "calculateInverseKinematics calculateInverseKinematics2",
    # What reads it, and changes nothing.
    "photographs": "getCameraImage",
    "reads states": "getBasePositionAndOrientation getBaseVelocity getLinkState getLinkStates "
    "getJointState getJointStates getJointStateMultiDof getJointStatesMultiDof "
    "getConstraintState getMeshData getTetraMeshData getAABB",
    "reads contacts": "getContactPoints getClosestPoints getOverlappingObjects rayTest "
    "rayTestBatch",
    "reads models": "getNumBodies getBodyUniqueId getBodyInfo getNumJoints getJointInfo "
    "getDynamicsInfo getVisualShapeData getCollisionShapeData getNumConstraints "
    "getConstraintUniqueId getConstraintInfo getPhysicsEngineParameters computeDofCount",
    "computes dynamics": "calculateInverseDynamics calculateJacobian calculateMassMatrix",
    "converts": "getAxisAngleFromQuaternion getAxisDifferenceQuaternion getDifferenceQuaternion "
    "getEulerFromQuaternion getMatrixFromQuaternion getQuaternionFromAxisAngle "
    "getQuaternionFromEuler getQuaternionSlerp calculateVelocityQuaternion multiplyTransforms "
    "invertTransform rotateVector computeProjectionMatrix computeProjectionMatrixFOV "
    "computeViewMatrix computeViewMatrixFromYawPitchRoll",
    # What is not about it.
    "polls": "getKeyboardEvents getMouseEvents getVREvents readUserDebugParameter isConnected "
    "getDebugVisualizerCamera",
    "draws": "addUserDebugLine addUserDebugPoints addUserDebugText",
    "sets a window": "addUserDebugParameter removeUserDebugItem removeAllUserDebugItems "
    "removeAllUserParameters setDebugObjectColor configureDebugVisualizer "
    "resetDebugVisualizerCamera setVRCameraState renderImage",
    "sets a path": "setAdditionalSearchPath",
    "writes files": "saveWorld saveBullet startStateLogging stopStateLogging vhacd",
    "keeps notes": "addUserData removeUserData getUserData getUserDataId getUserDataInfo "
    "getNumUserData syncUserData",
    "asks for the client": "getConnectionInfo getAPIVersion isNumpyEnabled setTimeOut "
    "submitProfileTiming syncBodyInfo",
}
"""Function names by role; a few functions have two roles."""


def those_that(*roles: str) -> frozenset[str]:
    """Return the functions of the given classes, such as those that step."""
    return frozenset(name for role in roles for name in ROLES[role].split())


COMMANDS = those_that("commands joints")
PUSHES = those_that("pushes")
MAKES_BODIES = those_that("makes bodies")
REMOVES_BODIES = those_that("removes bodies")
MOVES_BODY = those_that("moves a body")
MOVES_ALL = those_that("moves all")
RECOLOURS = those_that("recolours")
SETS_ENGINE = those_that("sets the engine")
CONSTRAINS = those_that("makes constraints", "removes constraints")
SHAPES = those_that("makes shapes")
READ_AGAIN = CONSTRAINS | those_that(
    "makes bodies",
    "removes bodies",
    "moves all",
    "recolours",
    "sets the engine",
    "makes shapes",
    "sets properties",
)
"""Functions after which properties are read again; the effect of other functions follows from the
call alone."""
RETURNS = frozenset(
    name
    for role in ROLES
    for name in ROLES[role].split()
    if name.startswith(("create", "load", "saveState"))
)
"""Functions that return an id that later calls use."""
IK = those_that("asks for joints")
POLLS = those_that("polls")
"""Functions with which a script checks for user input."""
DRAWS = those_that("draws")
CONVERTS = those_that("converts")
PHOTOGRAPHS = ROLES["photographs"]
READS = CONVERTS | those_that("reads states", "reads contacts", "reads models", "computes dynamics")
CHANGES_NOTHING = READS | those_that(
    "polls",
    "draws",
    "sets a window",
    "writes files",
    "keeps notes",
    "asks for the client",
)
"""Functions that change nothing. For functions that read values, only the calling line and errors
are recorded."""

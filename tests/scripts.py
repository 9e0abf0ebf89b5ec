"""Small scripts as users write them, for the tests of `drop record`.

Each ends by printing, to the last bit, what the engine has: the same with and without recording.
"""

from __future__ import annotations

import textwrap

SHOW = """
def show(p, *clients):
    for c in clients or (0,):
        for i in range(p.getNumBodies(physicsClientId=c)):
            b = p.getBodyUniqueId(i, physicsClientId=c)
            said = [p.getBasePositionAndOrientation(b, physicsClientId=c),
                    p.getBaseVelocity(b, physicsClientId=c)]
            n = p.getNumJoints(b, physicsClientId=c)
            if n:
                said.append(p.getJointStates(b, list(range(n)), physicsClientId=c))
            print(c, b, repr(said))
        print(repr(p.getContactPoints(physicsClientId=c)))
"""
"""Code that prints the engine's final state; `repr` of a float is exact."""

HEAD = """
import pybullet as p, pybullet_data
from show import show
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
"""

PLAIN: dict[str, str] = {
    "box": HEAD
    + """
        p.loadURDF("plane.urdf")
        b = p.loadURDF("cube_small.urdf", [0, 0, 0.3], p.getQuaternionFromEuler([0.3, 0.2, 0]))
        for i in range(240):
            p.stepSimulation()
        show(p)
    """,
    "star": """
        from pybullet import *
        import pybullet_data
        import pybullet as module
        from show import show
        connect(DIRECT)
        setAdditionalSearchPath(pybullet_data.getDataPath())
        setGravity(0, 0, -10)
        loadURDF("plane.urdf")
        loadURDF("cube_small.urdf", [0, 0, 1])
        for i in range(120):
            stepSimulation()
        show(module)
    """,
    "client": """
        import pybullet, pybullet_data
        from pybullet_utils.bullet_client import BulletClient
        from show import show
        first = BulletClient(pybullet.DIRECT)
        second = BulletClient(connection_mode=pybullet.DIRECT)
        for n, c in enumerate((first, second)):
            c.setAdditionalSearchPath(pybullet_data.getDataPath())
            c.setGravity(0, 0, -9.81 - n)
            c.loadURDF("plane.urdf")
            c.loadURDF("cube_small.urdf", [n, 0, 0.2])
        for i in range(100):
            first.stepSimulation()
            if i % 2:
                second.stepSimulation()
        show(pybullet, 0, 1)
    """,
    "positional": HEAD
    + """
        other = p.connect(p.DIRECT)
        p.setGravity(0, 0, -1.6, other)
        ball = p.createCollisionShape(p.GEOM_SPHERE, 0.1, physicsClientId=other)
        b = p.createMultiBody(1.0, ball,
            basePosition=[0, 0, 1], physicsClientId=other)
        for i in range(50):
            p.stepSimulation(other)
        p.resetBaseVelocity(b, [1, 0, 0], [0, 0, 1], other)
        for i in range(50):
            p.stepSimulation(physicsClientId=other)
        show(p, other)
    """,
    "made": HEAD
    + """
        floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.2, 0.05])
        seen = p.createVisualShape(p.GEOM_CAPSULE, radius=0.1, length=0.3, rgbaColor=[1, 0, 0, 1])
        for i in range(5):
            p.createMultiBody(0.5, box if i % 2 else ball, seen, [0.05 * i, 0, 0.3 + 0.3 * i],
                baseInertialFramePosition=[0.01, 0, 0])
        links = p.createMultiBody(1, box, basePosition=[2, 0, 1], linkMasses=[1, 1],
            linkCollisionShapeIndices=[ball, ball], linkVisualShapeIndices=[-1, -1],
            linkPositions=[[0, 0, 0.3], [0, 0, 0.3]], linkOrientations=[[0, 0, 0, 1]] * 2,
            linkInertialFramePositions=[[0, 0, 0]] * 2,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0, 1],
            linkJointTypes=[p.JOINT_REVOLUTE, p.JOINT_PRISMATIC], linkJointAxis=[[0, 1, 0]] * 2)
        for i in range(200):
            p.applyExternalForce(links, -1, [0.5, 0, 0], [0, 0, 0], p.LINK_FRAME)
            p.stepSimulation()
        show(p)
    """,
    "maximal": HEAD
    + """
        p.loadURDF("plane.urdf")
        p.loadURDF("cube_small.urdf", [0, 0, 0.4], [0.2, 0, 0, 1], useMaximalCoordinates=True)
        p.loadURDF("cube_small.urdf", [0.01, 0, 0.9])
        for i in range(240):
            p.stepSimulation()
        show(p)
    """,
    "robot": HEAD
    + """
        kuka = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
        for j in range(p.getNumJoints(kuka)):
            p.resetJointState(kuka, j, 0.1 * j)
        for i in range(120):
            for j in range(p.getNumJoints(kuka)):
                p.setJointMotorControl2(kuka, j, p.POSITION_CONTROL, targetPosition=0.3, force=50)
            p.stepSimulation()
        show(p)
    """,
    "spherical": HEAD
    + """
        h = p.loadURDF("humanoid/humanoid.urdf", [0, 0, 4])
        p.loadURDF("plane.urdf")
        for i in range(100):
            p.stepSimulation()
        show(p)
    """,
    "constraint": HEAD
    + """
        a = p.loadURDF("cube_small.urdf", [0, 0, 2])
        b = p.loadURDF("cube_small.urdf", [0.2, 0, 2])
        c = p.createConstraint(a, -1, b, -1, p.JOINT_POINT2POINT, [0, 0, 1], [0.1, 0, 0],
            [-0.1, 0, 0])
        hold = p.createConstraint(a, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 2])
        for i in range(100):
            p.stepSimulation()
        p.changeConstraint(hold, maxForce=0.1)
        for i in range(50):
            p.stepSimulation()
        p.removeConstraint(c)
        for i in range(50):
            p.stepSimulation()
        show(p)
    """,
    "reset": HEAD
    + """
        for episode in range(3):
            p.resetSimulation()
            p.setGravity(0, 0, -9.81)
            p.loadURDF("plane.urdf")
            b = p.loadURDF("cube_small.urdf", [0, 0, 0.1 + 0.1 * episode])
            for i in range(40):
                p.stepSimulation()
        show(p)
    """,
    "saved": HEAD
    + """
        p.loadURDF("plane.urdf")
        b = p.loadURDF("cube_small.urdf", [0, 0, 0.2], [0.1, 0.2, 0, 1])
        for i in range(30):
            p.stepSimulation()
        kept = p.saveState()
        for i in range(30):
            p.stepSimulation()
        p.restoreState(kept)
        for i in range(30):
            p.stepSimulation()
        show(p)
    """,
    "come_and_go": HEAD
    + """
        p.loadURDF("plane.urdf")
        for i in range(60):
            if i % 10 == 0:
                b = p.loadURDF("cube_small.urdf", [0, 0, 0.5 + 0.01 * i])
            p.stepSimulation()
            if i % 20 == 19:
                p.removeBody(b)
        c = p.loadURDF("sphere_small.urdf", [0, 0, 1])
        for i in range(20):
            p.stepSimulation()
        show(p)
    """,
    "moved": HEAD
    + """
        b = p.loadURDF("cube_small.urdf", [0, 0, 1])
        for i in range(60):
            if i % 20 == 10:
                p.resetBasePositionAndOrientation(b, [0, 0, i], [0, 0, 0, 1])
                p.resetBaseVelocity(b, [i, 0, 0])
            p.stepSimulation()
        p.changeDynamics(b, -1, mass=2.5, linearDamping=0, lateralFriction=0.3)
        p.setTimeStep(1 / 100)
        p.setPhysicsEngineParameter(numSubSteps=3, erp=0.3)
        for i in range(20):
            p.stepSimulation()
        show(p)
    """,
    "posed": HEAD
    + """
        b = p.loadURDF("r2d2.urdf", [0, 0, 1])
        for i in range(10):
            p.resetBasePositionAndOrientation(b, [0.1 * i, 0, 1], [0, 0, 0, 1])
        show(p)
    """,
    "camera": HEAD
    + """
        p.loadURDF("plane.urdf")
        b = p.loadURDF("cube_small.urdf", [0, 0, 0.5])
        view = p.computeViewMatrix([1, 1, 1], [0, 0, 0.2], [0, 0, 1])
        lens = p.computeProjectionMatrixFOV(60, 4 / 3, 0.1, 10)
        total = 0
        for i in range(60):
            p.stepSimulation()
            if i % 20 == 0:
                picture = p.getCameraImage(64, 48, view, lens)
                total += int(sum(picture[2].ravel().tolist()))
                p.getCameraImage(32, 32)
        print(total)
        show(p)
    """,
    "threads": HEAD
    + """
        import threading
        p.loadURDF("plane.urdf")
        b = p.loadURDF("cube_small.urdf", [0, 0, 0.2])
        def run(n):
            for i in range(n):
                p.stepSimulation()
        one = threading.Thread(target=run, args=(50,))
        one.start(); one.join()
        run(50)
        show(p)
    """,
    "arguments": HEAD
    + """
        import argparse, sys
        parser = argparse.ArgumentParser()
        parser.add_argument("--height", type=float)
        parser.add_argument("--force", action="store_true")
        parser.add_argument("rest", nargs="*")
        def main(options):
            p.loadURDF("cube_small.urdf", [0, 0, options.height])
            for i in range(10):
                p.stepSimulation()
            show(p)
            print(options, sys.argv, __file__, __name__, __package__, sys.path[0])
        if __name__ == "__main__":
            main(parser.parse_args())
    """,
    "own_names": HEAD
    + """
        import pipeline, cli, tests
        print(pipeline.MINE, cli.MINE, tests.MINE)
        p.loadURDF("cube_small.urdf", [0, 0, 1])
        p.stepSimulation()
        show(p)
    """,
    "kept": HEAD
    + """
        import pickle, inspect, copy
        step, getter = p.stepSimulation, p.getBaseVelocity
        print(inspect.isbuiltin(step), type(step).__name__ != "", step.__name__, step.__doc__[:20])
        print(isinstance(step, type(len)), callable(step), repr(step))
        print(pickle.loads(pickle.dumps(step)) is step, copy.deepcopy(step) is step)
        b = p.loadURDF("cube_small.urdf", [0, 0, 1])
        for i in range(5):
            step()
        print(getter(b))
        show(p)
    """,
    "looked_at": HEAD
    + """
        import copy, functools, inspect, io, pickle, pydoc, types, weakref
        for f in (p.stepSimulation, p.getAPIVersion):
            print(isinstance(f, types.BuiltinFunctionType), isinstance(f, types.FunctionType))
            print(inspect.isbuiltin(f), inspect.isroutine(f), inspect.isfunction(f), callable(f))
            print(f.__self__ is p, f.__name__, f.__qualname__, f.__module__, f.__doc__)
            print(f.__class__, repr(f), f, f.__text_signature__, type(f).__name__, sorted(dir(f)))
            print([hasattr(f, n) for n in ("__wrapped__", "__code__", "__dict__", "__get__")])
            print(inspect.getmodule(f) is p, inspect.getdoc(f), pydoc.render_doc(f))
            print(copy.copy(f) is f, copy.deepcopy(f) is f, pickle.loads(pickle.dumps(f)) is f)
            print(pickle.dumps(f), f == getattr(p, f.__name__), f in {f: 1}, weakref.ref(f)() is f)
            print(functools.update_wrapper(lambda: 0, f).__doc__, functools.partial(f))
            for wrong in (
                lambda: inspect.signature(f), lambda: inspect.getsource(f), lambda: vars(f),
                lambda: setattr(f, "x", 1), lambda: setattr(f, "__name__", "x"),
                lambda: delattr(f, "__doc__"), lambda: setattr(f, "__class__", int),
                lambda: f.x, lambda: f(1, 2, 3, 4), lambda: f(x=1),
            ):
                try:
                    print(wrong())
                except Exception as error:
                    print(type(error), error)
        print([name for name, _ in inspect.getmembers(p, inspect.isbuiltin)])
        show(p)
    """,
    "takes_apart": HEAD
    + """
        import json, linecache, os, struct, sys, threading, types
        print(__annotations__, __loader__.name, sorted(globals()), sys.modules["__main__"])
        __annotations__["of"] = "mine"
        here: int = 3
        p.loadURDF("plane.urdf")
        b = p.loadURDF("cube_small.urdf", [0, 0, 0.3])
        json.dumps = json.loads = json.JSONEncoder = os.write = os.fstat = os.getpid = None
        struct.Struct = sys._getframe = threading.get_ident = linecache.getline = None
        for i in range(50):
            p.applyExternalForce(b, -1, [0, i, 0], [0, 0, 0], p.LINK_FRAME)
            p.stepSimulation()
        print(__annotations__)
        show(p)
    """,
    "errors": HEAD
    + """
        for wrong in (lambda: p.loadURDF("nothing.urdf"),
                      lambda: p.resetBaseVelocity(99, [0, 0, 0]), lambda: p.stepSimulation(7),
                      lambda: p.setGravity("a"), lambda: p.getBodyInfo(),
                      lambda: p.setTimeStep(nothing=1), lambda: p.setGravity(0, 0, 0, "x")):
            try:
                print(wrong())
            except Exception as error:
                print(type(error).__name__, error)
        p.loadURDF("cube_small.urdf", [0, 0, 1])
        p.stepSimulation()
        show(p)
    """,
    "numpy": HEAD
    + """
        import numpy as np
        b = p.loadURDF("cube_small.urdf", np.array([0, 0, 1.0]))
        p.resetBaseVelocity(b, np.float64([1, 2, 3]), (np.float32(0.5), 0, 0))
        p.applyExternalForce(np.int64(b), -1, np.array([1.0, 0, 0]), [0, 0, 0], p.WORLD_FRAME)
        for i in range(10):
            p.stepSimulation()
        show(p)
    """,
    "soft": HEAD
    + """
        p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD)
        p.setGravity(0, 0, -10)
        p.loadURDF("plane.urdf")
        s = p.loadSoftBody("cloth_z_up.obj", basePosition=[0, 0, 1], scale=0.5, mass=1,
            useNeoHookean=0, useBendingSprings=1, useMassSpring=1, springElasticStiffness=40,
            springDampingStiffness=0.1, useSelfCollision=0, frictionCoeff=0.5, useFaceContact=1)
        b = p.loadURDF("cube_small.urdf", [0, 0, 1.5])
        for i in range(30):
            p.stepSimulation()
        print(p.getBasePositionAndOrientation(b), p.getMeshData(s)[1][:3])
    """,
    "disconnects": """
        import pybullet as p, pybullet_data
        from show import show
        for run in range(3):
            c = p.connect(p.DIRECT)
            p.setAdditionalSearchPath(pybullet_data.getDataPath())
            p.setGravity(0, 0, -10)
            p.loadURDF("cube_small.urdf", [0, 0, 1 + run])
            for i in range(20):
                p.stepSimulation()
            show(p, c)
            p.disconnect()
        print(p.isConnected())
    """,
    "nothing": """
        print("no simulation here")
    """,
    "exits": HEAD
    + """
        import atexit, sys
        p.loadURDF("cube_small.urdf", [0, 0, 1])
        p.stepSimulation()
        show(p)
        atexit.register(lambda: print("at the end", p.isConnected()))
        sys.exit()
    """,
}
"""Scripts that need no window and end by themselves."""

ARGUMENTS = {"arguments": ["--height", "0.5", "--force", "--", "-x", "y z"]}

PLAIN = {
    name: textwrap.dedent(text)
    if not text.startswith(HEAD)
    else HEAD + textwrap.dedent(text[len(HEAD) :])
    for name, text in PLAIN.items()
}

WINDOW = """
import pybullet as p, pybullet_data, time
from show import show
p.connect(p.GUI)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -10)
p.loadURDF("plane.urdf")
b = p.loadURDF("cube_small.urdf", [0, 0, 1])
"""
"""The beginning of a script that opens a window."""

"""A scene: some objects on the table, apart from each other, at rest, in a PyBullet client."""

from __future__ import annotations

import functools
import math
import weakref
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import pybullet
from numpy.typing import NDArray
from scipy.spatial import KDTree

from equigrasp.errors import InputError
from equigrasp.workspace import WORKSPACE, Motion
from tasks.arrangement import check_clearance
from tasks.gripper import STEP, Gripper, Phase, Reach
from tasks.judge import RISE
from tasks.objects import ObjectAsset
from tasks.surface import Visible, surface

SETTLED = (0.003, 0.05)
"""At rest: slower than this in m/s and rad/s."""
REMOVED = (0.0, -6.0)
"""Where removed objects go, out of every camera's sight."""


class Client:
    """A PyBullet client without a window: PyBullet's functions, bound to it.

    `pybullet_utils.bullet_client` does the same and prints to the terminal. A client that nobody has any more is
    disconnected; one that still lives when the interpreter ends goes with its process.

    Raises:
        RuntimeError: if PyBullet has no client left to give; a process may have about a thousand.
    """

    def __init__(self) -> None:
        self._id = pybullet.connect(pybullet.DIRECT)
        if self._id < 0:
            raise RuntimeError("PyBullet gave no client; are there environments that were not closed?")
        # called once at the most: afterwards PyBullet gives the number to somebody else
        self._disconnect = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._id)
        self._disconnect.atexit = False

    def disconnect(self) -> None:
        """Free the simulator; done twice it does nothing more."""
        self._disconnect()

    def __getattr__(self, name: str) -> Callable[..., Any]:
        bound = functools.partial(getattr(pybullet, name), physicsClientId=self._id)
        setattr(self, name, bound)
        return bound

    def __reduce__(self) -> NoReturn:
        """Raise an InputError: a copy would be another name for the same simulator, and none for one elsewhere."""
        raise InputError(
            "an environment with a scene cannot be copied or pickled, because its simulator cannot; make another one "
            "and reset it with the same seed"
        )


@dataclass(frozen=True)
class Pose:
    """Where a body is: position `(3,)` in metres and rotation `(3, 3)`, object -> world."""

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]

    def to_object(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """World points `(N, 3)` in the object's frame."""
        return (points - self.position) @ self.rotation


class Scene:
    """The world of one episode: table, hand and objects, in a client that it resets first.

    `resetSimulation` and loading everything again is bit-identical for the same arguments, whatever the
    client did before, and does not leak; moving a pool of bodies about, or removing single ones, is neither.

    Args:
        bullet: the client.
        assets: what lies on the table.
        poses: where, one for each asset.

    Attributes:
        bodies: id of each object's body by name, without those that were removed.
        gripper: the hand.
    """

    def __init__(self, bullet: Client, assets: Sequence[ObjectAsset], poses: Sequence[Motion]) -> None:
        self._bullet = bullet
        self._assets = {asset.name: asset for asset in assets}
        bullet.resetSimulation()
        bullet.setGravity(0, 0, -9.81)
        bullet.setTimeStep(STEP)
        bullet.setPhysicsEngineParameter(numSolverIterations=50, deterministicOverlappingPairs=1)
        # a body without a visual shape is drawn as its collision shape, and the camera draws the table itself; a table
        # in reduced coordinates would cost each contact with it three times as much
        speck = bullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=[1e-4] * 3, visualFramePosition=[*REMOVED, 0])
        plane = bullet.createCollisionShape(pybullet.GEOM_PLANE)
        self._table: int = bullet.createMultiBody(0, plane, speck, useMaximalCoordinates=1)
        self.bodies: dict[str, int] = {
            asset.name: self._load(asset, pose) for asset, pose in zip(assets, poses, strict=True)
        }
        self._settle()
        self.gripper = Gripper(bullet)

    def _load(self, asset: ObjectAsset, pose: Motion) -> int:
        bullet = self._bullet
        body = bullet.createMultiBody(
            asset.mass,
            bullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(asset.collision)),
            bullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(asset.visual)),
            [pose.x, pose.y, asset.rest_height],
            bullet.getQuaternionFromEuler([0, 0, pose.angle]),
            useMaximalCoordinates=1,
        )
        if asset.paint is not None:
            color = [channel / 255 for channel in asset.paint]
            bullet.changeVisualShape(body, -1, textureUniqueId=-1, rgbaColor=[*color, 1.0])
        # rolling friction would double the solver's work, and nothing here rolls far
        bullet.changeDynamics(body, -1, lateralFriction=0.8, spinningFriction=0.005)
        return body

    def asset(self, name: str) -> ObjectAsset:
        """The asset of an object in the scene."""
        return self._assets[name]

    def pose(self, name: str) -> Pose:
        """Where an object is now."""
        position, quaternion = self._bullet.getBasePositionAndOrientation(self.bodies[name])
        rotation = np.array(self._bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        return Pose(np.array(position), rotation)

    def truth(self) -> list[dict[str, Any]]:
        """What lies on the table, as plain values: name, position in metres, orientation as quaternion xyzw."""
        where = {name: self._bullet.getBasePositionAndOrientation(body) for name, body in self.bodies.items()}
        return [{"name": name, "position": p, "orientation": q} for name, (p, q) in where.items()]

    def visible(self) -> list[Visible]:
        """What cameras see of the objects now."""
        poses = {name: self.pose(name) for name in self.bodies}
        return [
            Visible(self.bodies[name], surface(self._assets[name]), pose.position, pose.rotation)
            for name, pose in poses.items()
        ]

    def turn(self, name: str, angle: float, clearance: float = 0.005) -> Motion:
        """Turn one object about its centre of mass by `angle` radians; everything else stays. Gives the motion.

        Raises:
            ValueError: if it would leave the workspace or come nearer than `clearance` to another, or that is less than
                `tasks.arrangement.LEAST_CLEARANCE`; nothing moved.
        """
        check_clearance(clearance)
        pose = self.pose(name)
        motion = Motion(angle).about(float(pose.position[0]), float(pose.position[1]))
        outline = motion(self._outline(name))
        others = [self._outline(other) for other in self.bodies if other != name]
        near = any(KDTree(other).query(outline)[0].min() < clearance for other in others)
        if near or (np.abs(outline) > np.array(WORKSPACE.bounds)[:, 1]).any():
            raise ValueError(f"there is no room to turn the {name} by {math.degrees(angle):.0f} degrees")
        position, quaternion = self._bullet.getBasePositionAndOrientation(self.bodies[name])
        turned = self._bullet.getQuaternionFromEuler([0, 0, angle])
        _, turned = pybullet.multiplyTransforms([0, 0, 0], turned, [0, 0, 0], quaternion)
        self._bullet.resetBasePositionAndOrientation(self.bodies[name], position, turned)
        self._bullet.changeDynamics(self.bodies[name], -1, activationState=pybullet.ACTIVATION_STATE_WAKE_UP)
        self._settle()
        return motion

    def parts_at(self, name: str, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The index of the object's part at each world point `(N, 3)`, -1 for none."""
        return self._assets[name].part_at(self.pose(name).to_object(points))

    def grasp(
        self, to: Reach, watch: Callable[[Phase], None] | None = None
    ) -> tuple[list[str], dict[str, list[str | None]]]:
        """Close the hand there, lift, and look what came along; `put_down` or `take` comes next.

        Args:
            to: where.
            watch: called with the hand's phase after each of its simulated steps, until it has let go.

        Returns:
            The names of the objects that were lifted, and for each object that a finger touched at closing,
            the part at each contact point (None where it is on no part).
        """
        gripper = self.gripper
        gripper.watch = watch
        before = {name: self.pose(name).position[2] for name in self.bodies}
        gripper.approach(to)
        gripper.close()
        touched = self._touched()
        gripper.lift()
        held = {contact.body for contact in gripper.contacts()}
        lifted = [
            name
            for name in self.bodies
            if self.bodies[name] in held
            and self.pose(name).position[2] - before[name] > RISE
            and not self._bullet.getContactPoints(bodyA=self.bodies[name], bodyB=self._table)
        ]
        return lifted, touched

    @contextmanager
    def rehearsal(self) -> Generator[None]:
        """What is grasped inside of this did not happen: all is where it was, to the last bit, and nothing in the hand.

        PyBullet's contacts do not come back in full, so that what the next grasp moves may end a little elsewhere than
        it would have. `docs/benchmark.md` says by how much.
        """
        state = self._bullet.saveState()
        try:
            yield
        finally:
            self._bullet.restoreState(stateId=state)
            self._bullet.removeState(state)
            self.gripper.park()
            self._sleep()

    def put_down(self) -> None:
        """After a grasp: lower and release whatever is in the hand, and let everything come to rest."""
        if self.gripper.contacts():
            self.gripper.put_down()
        self._finish()

    def take(self, name: str) -> None:
        """After a grasp: keep the lifted object, which is off the table for the rest of the episode."""
        body = self.bodies.pop(name)
        # a body whose mass is taken keeps the velocity that it had
        self._bullet.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0])
        self._bullet.changeDynamics(body, -1, mass=0)
        self._bullet.setCollisionFilterGroupMask(body, -1, 0, 0)
        self._bullet.resetBasePositionAndOrientation(body, [*REMOVED, 0], [0, 0, 0, 1])
        self._finish()

    def _finish(self) -> None:
        self.gripper.park()
        self.gripper.watch = None
        self._settle()

    def _outline(self, name: str) -> NDArray[np.float64]:
        """The object's footprint where it is now, `(K, 2)` metres."""
        pose = self.pose(name)
        return pose.position[:2] + self._assets[name].footprint @ pose.rotation[:2, :2].T

    def _touched(self) -> dict[str, list[str | None]]:
        contacts = self.gripper.contacts()
        touched = {}
        for name, body in self.bodies.items():
            points = [contact.position for contact in contacts if contact.body == body]
            if points:
                parts = self._assets[name].parts
                indices = self.parts_at(name, np.array(points))
                touched[name] = [parts[index] if index >= 0 else None for index in indices]
        return touched

    def _settle(self, steps: int = 480) -> None:
        """Simulate until everything stands still, `steps` steps at most, and let it sleep."""
        still = 0
        for _ in range(steps):
            self._bullet.stepSimulation()
            still = still + 1 if all(self._at_rest(body) for body in self.bodies.values()) else 0
            if still == 8:
                break
        self._sleep()

    def _sleep(self) -> None:
        """Bullet passes over what sleeps, so that it does not creep, until something that moves comes near."""
        for body in self.bodies.values():
            self._bullet.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0])
        for body in (self._table, *self.bodies.values()):
            self._bullet.changeDynamics(body, -1, activationState=pybullet.ACTIVATION_STATE_SLEEP)

    def _at_rest(self, body: int) -> bool:
        linear, angular = self._bullet.getBaseVelocity(body)
        return math.hypot(*linear) < SETTLED[0] and math.hypot(*angular) < SETTLED[1]

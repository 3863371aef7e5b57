"""The hand: a Panda's parallel gripper on a gantry, and the one thing it does, which is to try a grasp.

Frame of the hand: the origin is midway between the fingertips, z up along the fingers, x along the closing
axis. Nothing here waits for a clock: a motion ends when it has arrived, stands still, or has used its steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pybullet
import pybullet_data

from equigrasp.grasp import Grasp, Observation
from equigrasp.hand import HAND
from equigrasp.workspace import WORKSPACE

Phase = Literal["approach", "close", "lift", "put down"]

STEP = 1.0 / 240.0

_ABOVE = 0.02
"""The fingertips start this high above everything near, metres."""
_UNDER = 0.14
"""What is nearer to the grasp than this, metres, might be under the hand."""
LIFT = 0.15
FRICTION = 0.625
"""Of a finger. Bullet multiplies it by the object's 0.8: 0.5 between the two, as in Dex-Net's configurations of grasp
quality for parallel jaws."""
FORCE = 20.0
"""Of each finger, newtons: the limit of effort of a finger's joint in the Panda that PyBullet ships."""
PRESS = 20.0
"""With how much the hand comes down, newtons, before what it meets stops it."""
STRENGTH = 100.0
"""With how much it is lifted and held, newtons."""

PARKED = (0.0, -3.0)
"""Where the hand waits, out of every camera's sight."""

SLIDE, LEFT, RIGHT = 0, 1, 2

_MESHES = Path(pybullet_data.getDataPath()) / "franka_panda" / "meshes" / "collision"


@dataclass(frozen=True)
class Reach:
    """Where the hand goes for a grasp, in the world.

    Attributes:
        x: metres.
        y: metres.
        theta: angle of the closing axis, radians.
        start: height from which the fingertips come down, metres, above everything that might be under the hand.
        tip: height at which they close, metres.
    """

    x: float
    y: float
    theta: float
    start: float
    tip: float


def reach(grasp: Grasp, seen: Observation) -> Reach:
    """Where the hand goes for this grasp, by the heightmap that was seen."""
    x, y = WORKSPACE.to_world([grasp.u, grasp.v]).tolist()
    u, v, _ = WORKSPACE.to_action(grasp)
    side = round(_UNDER / WORKSPACE.pixel)
    near = seen.height[max(v - side, 0) : v + side + 1, max(u - side, 0) : u + side + 1]
    return Reach(x, y, grasp.theta, float(near.max()) + _ABOVE, max(HAND.floor, float(seen.height[v, u]) - HAND.depth))


@dataclass(frozen=True)
class Contact:
    """A point where a finger touches a body, or all but.

    Attributes:
        body: the body's id in PyBullet.
        position: x, y, z in the world, metres.
    """

    body: int
    position: tuple[float, float, float]


class Gripper:
    """The hand in a PyBullet client; made anew after each `resetSimulation`.

    The gantry carries x, y and yaw as the pose of the hand's base, which is put in place in one go while the
    hand is above everything; z and the two fingers are joints with motors and limited forces.

    Args:
        bullet: the client.

    Attributes:
        body: its id in PyBullet.
        watch: called with the phase after each simulated step of a motion; for films.
    """

    def __init__(self, bullet: Any) -> None:
        self._bullet = bullet
        self.watch: Callable[[Phase], None] | None = None
        self._phase: Phase = "approach"
        palm_center, finger_center = [0, 0, HAND.finger_length + HAND.palm[2] / 2], HAND.finger_length / 2
        palm = bullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=[side / 2 for side in HAND.palm], collisionFramePosition=palm_center
        )
        # Franka's frame: z towards the fingertips, y along the closing axis, and the fingertips 0.112 m away
        palm_visual = bullet.createVisualShape(
            pybullet.GEOM_MESH,
            fileName=str(_MESHES / "hand.obj"),
            visualFramePosition=[0, 0, 0.112],
            visualFrameOrientation=[math.sqrt(0.5), math.sqrt(0.5), 0, 0],
            rgbaColor=[0.95, 0.95, 0.94, 1],
        )
        fingers = []
        for side in (1, -1):
            solid = bullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=[HAND.finger_thickness / 2, HAND.finger_width / 2, HAND.finger_length / 2],
                collisionFramePosition=[side * HAND.finger_thickness / 2, 0, finger_center],
            )
            visual = bullet.createVisualShape(
                pybullet.GEOM_MESH,
                fileName=str(_MESHES / "finger.obj"),
                visualFramePosition=[0, 0, 0.0538],
                visualFrameOrientation=bullet.getQuaternionFromEuler([math.pi, 0, -side * math.pi / 2]),
                rgbaColor=[0.25, 0.25, 0.27, 1],
            )
            fingers.append((solid, visual))
        upright, origin = [0, 0, 0, 1], [0, 0, 0]
        self.body: int = bullet.createMultiBody(
            baseMass=0,
            basePosition=[*PARKED, 0],
            linkMasses=[0.8, 0.1, 0.1],
            linkCollisionShapeIndices=[palm, fingers[0][0], fingers[1][0]],
            linkVisualShapeIndices=[palm_visual, fingers[0][1], fingers[1][1]],
            linkPositions=[origin] * 3,
            linkOrientations=[upright] * 3,
            linkInertialFramePositions=[origin] * 3,
            linkInertialFrameOrientations=[upright] * 3,
            linkParentIndices=[0, 1, 1],
            linkJointTypes=[pybullet.JOINT_PRISMATIC] * 3,
            linkJointAxis=[[0, 0, 1], [1, 0, 0], [-1, 0, 0]],
        )
        for finger in (LEFT, RIGHT):
            bullet.changeDynamics(
                self.body, finger, lateralFriction=FRICTION, jointLowerLimit=0.0, jointUpperLimit=HAND.opening / 2
            )
        gear = bullet.createConstraint(
            self.body, LEFT, self.body, RIGHT, pybullet.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        bullet.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)
        self.park()

    def park(self) -> None:
        """Open, and out of sight."""
        self._place(*PARKED, 0.3, 0.0)

    def approach(self, to: Reach) -> None:
        """Open above the grasp, then down. What is in the way is pushed with limited force, and may stop the hand.

        Where it was stopped it stays, and presses no longer.
        """
        self._phase = "approach"
        self._place(to.x, to.y, to.start, to.theta)
        self._move(to.tip, speed=0.5, force=PRESS)
        self._drive(max(to.tip, self._bullet.getJointState(self.body, SLIDE)[0]), speed=0.5, force=STRENGTH)

    def close(self) -> None:
        """Close the fingers until they stand still."""
        self._phase = "close"
        still = 0
        for finger in (LEFT, RIGHT):
            self._bullet.setJointMotorControl2(
                self.body, finger, pybullet.VELOCITY_CONTROL, targetVelocity=-0.2, force=FORCE
            )
        for _ in range(120):
            self._step()
            speeds = [self._bullet.getJointState(self.body, finger)[1] for finger in (LEFT, RIGHT)]
            still = still + 1 if max(abs(speed) for speed in speeds) < 0.01 else 0
            if still == 6:
                break

    def lift(self) -> None:
        """Up by LIFT, and hold for a moment."""
        self._phase = "lift"
        self._move(self._bullet.getJointState(self.body, SLIDE)[0] + LIFT, speed=1.0)
        for _ in range(12):
            self._step()

    def put_down(self) -> None:
        """Down again by LIFT, open, and up."""
        self._phase = "put down"
        self._move(self._bullet.getJointState(self.body, SLIDE)[0] - LIFT, speed=0.6)
        for finger in (LEFT, RIGHT):
            self._bullet.setJointMotorControl2(
                self.body, finger, pybullet.VELOCITY_CONTROL, targetVelocity=0.2, force=FORCE
            )
        for _ in range(48):
            self._step()
        self._move(self._bullet.getJointState(self.body, SLIDE)[0] + LIFT, speed=0.6)

    def contacts(self) -> list[Contact]:
        """Where the fingers touch other bodies now.

        These are all of PyBullet's points of contact: those within its margin of a fraction of a millimetre count too,
        whether they carry force or not.
        """
        return [
            Contact(point[2], point[6])
            for finger in (LEFT, RIGHT)
            for point in self._bullet.getContactPoints(bodyA=self.body, linkIndexA=finger)
        ]

    def _place(self, x: float, y: float, z: float, theta: float) -> None:
        bullet = self._bullet
        bullet.resetBasePositionAndOrientation(self.body, [x, y, 0], bullet.getQuaternionFromEuler([0, 0, theta]))
        bullet.resetJointState(self.body, SLIDE, z)
        bullet.setJointMotorControl2(
            self.body, SLIDE, pybullet.POSITION_CONTROL, targetPosition=z, force=STRENGTH, maxVelocity=1.0
        )
        for finger in (LEFT, RIGHT):
            bullet.resetJointState(self.body, finger, HAND.opening / 2)
            bullet.setJointMotorControl2(self.body, finger, pybullet.VELOCITY_CONTROL, targetVelocity=0.2, force=FORCE)

    def _drive(self, z: float, speed: float, force: float) -> None:
        self._bullet.setJointMotorControl2(
            self.body,
            SLIDE,
            pybullet.POSITION_CONTROL,
            targetPosition=z,
            force=force,
            maxVelocity=speed,
            positionGain=0.5,
        )

    def _move(self, z: float, speed: float, force: float = STRENGTH) -> None:
        self._drive(z, speed, force)
        still = 0
        for _ in range(240):
            self._step()
            position, velocity = self._bullet.getJointState(self.body, SLIDE)[:2]
            still = still + 1 if abs(velocity) < 0.01 else 0
            if abs(position - z) < 0.001 or still == 12:
                break

    def _step(self) -> None:
        self._bullet.stepSimulation()
        if self.watch is not None:
            self.watch(self._phase)

"""The hand: a Panda's parallel gripper on a gantry, and the one thing it does, which is to try a grasp.

Frame of the hand: the origin is midway between the fingertips, z up along the fingers, x along the closing
axis. Nothing here waits for a clock: a motion ends when it has arrived, stands still, or has used its steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pybullet

STEP = 1.0 / 240.0

OPENING = 0.08
"""Distance between the open fingers' inner faces, metres."""
FINGER_THICKNESS = 0.010
FINGER_WIDTH = 0.020
FINGER_LENGTH = 0.046
"""From the fingertips to the palm, metres."""
PALM = (0.204, 0.063, 0.066)

DEPTH = 0.038
"""How far below the surface at the grasp's pixel the fingertips go, metres."""
FLOOR = 0.004
"""The fingertips stay this high above the table, metres."""
LIFT = 0.15

PARKED = (0.0, -3.0)
"""Where the hand waits, out of every camera's sight."""

SLIDE, LEFT, RIGHT = 0, 1, 2

WHITE, DARK, GREY = (0.93, 0.93, 0.92, 1.0), (0.16, 0.16, 0.18, 1.0), (0.72, 0.72, 0.72, 1.0)


def fingertip_height(surface: float) -> float:
    """How high the fingertips go, in metres, to grasp where the heightmap reads `surface` metres."""
    return max(FLOOR, surface - DEPTH)


@dataclass(frozen=True)
class Contact:
    """A point where a finger touches a body.

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
        watch: called after each simulated step of a motion; for films.
    """

    def __init__(self, bullet: Any) -> None:
        self._bullet = bullet
        self.watch: Callable[[], None] | None = None
        half_palm = [side / 2 for side in PALM]
        half_finger = [FINGER_THICKNESS / 2, FINGER_WIDTH / 2, FINGER_LENGTH / 2]
        above = FINGER_LENGTH + half_palm[2]
        palm = bullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=half_palm, collisionFramePosition=[0, 0, above]
        )
        # a body that narrows upwards, a flange, and the rail that the fingers run in
        palm_visual = bullet.createVisualShapeArray(
            shapeTypes=[pybullet.GEOM_BOX, pybullet.GEOM_BOX, pybullet.GEOM_CYLINDER],
            halfExtents=[[half_palm[0], half_palm[1] * 0.8, 0.018], [0.055, half_palm[1], 0.016], [0, 0, 0]],
            radii=[0, 0, 0.032],
            lengths=[0, 0, 0.05],
            visualFramePositions=[
                [0, 0, FINGER_LENGTH + 0.018],
                [0, 0, above + 0.018],
                [0, 0, above + 0.055],
            ],
            rgbaColors=[WHITE, WHITE, GREY],
        )
        links = {}
        for side in (1, -1):
            frame = [side * half_finger[0], 0, half_finger[2]]
            links[side] = (
                bullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half_finger, collisionFramePosition=frame),
                bullet.createVisualShape(
                    pybullet.GEOM_BOX, halfExtents=half_finger, visualFramePosition=frame, rgbaColor=DARK
                ),
            )
        upright, origin = [0, 0, 0, 1], [0, 0, 0]
        self.body: int = bullet.createMultiBody(
            baseMass=0,
            basePosition=[*PARKED, 0],
            linkMasses=[0.8, 0.1, 0.1],
            linkCollisionShapeIndices=[palm, links[1][0], links[-1][0]],
            linkVisualShapeIndices=[palm_visual, links[1][1], links[-1][1]],
            linkPositions=[origin] * 3,
            linkOrientations=[upright] * 3,
            linkInertialFramePositions=[[0, 0, above], [0, 0, half_finger[2]], [0, 0, half_finger[2]]],
            linkInertialFrameOrientations=[upright] * 3,
            linkParentIndices=[0, 1, 1],
            linkJointTypes=[pybullet.JOINT_PRISMATIC] * 3,
            linkJointAxis=[[0, 0, 1], [1, 0, 0], [-1, 0, 0]],
        )
        for finger in (LEFT, RIGHT):
            bullet.changeDynamics(
                self.body, finger, lateralFriction=1.0, jointLowerLimit=0.0, jointUpperLimit=OPENING / 2
            )
        gear = bullet.createConstraint(
            self.body, LEFT, self.body, RIGHT, pybullet.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        bullet.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)
        self.park()

    def park(self) -> None:
        """Open, and out of sight."""
        self._place(*PARKED, 0.3, 0.0)

    def approach(self, x: float, y: float, theta: float, start: float, tip: float) -> None:
        """Open above (x, y), the fingertips at height `start`; then down until they are at `tip`.

        Metres and radians. What is in the way is pushed with limited force, and may stop the hand.
        """
        self._place(x, y, start, theta)
        self._move(tip, speed=0.5)

    def close(self) -> None:
        """Close the fingers until they stand still."""
        still = 0
        for finger in (LEFT, RIGHT):
            self._bullet.setJointMotorControl2(
                self.body, finger, pybullet.VELOCITY_CONTROL, targetVelocity=-0.2, force=40
            )
        for _ in range(120):
            self._step()
            speeds = [self._bullet.getJointState(self.body, finger)[1] for finger in (LEFT, RIGHT)]
            still = still + 1 if max(abs(speed) for speed in speeds) < 0.01 else 0
            if still == 6:
                break

    def lift(self) -> None:
        """Up by LIFT, and hold for a moment."""
        self._move(self._bullet.getJointState(self.body, SLIDE)[0] + LIFT, speed=0.6)
        for _ in range(12):
            self._step()

    def put_down(self) -> None:
        """Down again by LIFT, open, and up."""
        self._move(self._bullet.getJointState(self.body, SLIDE)[0] - LIFT, speed=0.6)
        for finger in (LEFT, RIGHT):
            self._bullet.setJointMotorControl2(
                self.body, finger, pybullet.VELOCITY_CONTROL, targetVelocity=0.2, force=40
            )
        for _ in range(48):
            self._step()
        self._move(self._bullet.getJointState(self.body, SLIDE)[0] + LIFT, speed=0.6)

    def contacts(self) -> list[Contact]:
        """Where the fingers touch other bodies now."""
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
            self.body, SLIDE, pybullet.POSITION_CONTROL, targetPosition=z, force=100, maxVelocity=0.6
        )
        for finger in (LEFT, RIGHT):
            bullet.resetJointState(self.body, finger, OPENING / 2)
            bullet.setJointMotorControl2(self.body, finger, pybullet.VELOCITY_CONTROL, targetVelocity=0.2, force=40)

    def _move(self, z: float, speed: float) -> None:
        self._bullet.setJointMotorControl2(
            self.body,
            SLIDE,
            pybullet.POSITION_CONTROL,
            targetPosition=z,
            force=100,
            maxVelocity=speed,
            positionGain=0.5,
        )
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
            self.watch()

"""A task of one's own, with objects from mesh files (docs/objects.md)."""

import pybullet_data

from tasks import Goal, Task
from tasks.meshes import MeshObject

DATA = pybullet_data.getDataPath()

PICK_MINE = Task(
    name="pick-mine",
    env_id="mine/PickMine-v0",
    goals=(Goal("toy-duck"), Goal("red-mug"), Goal("blue-ball"), Goal("fork", "head"), Goal("banana", color="purple")),
    objects=(3, 4),
    own=(
        MeshObject("toy-duck", f"{DATA}/duck_vhacd.urdf", up="y"),
        MeshObject("red-mug", f"{DATA}/objects/mug.urdf", color="red"),
        MeshObject("blue-ball", f"{DATA}/soccerball.urdf", scale=0.06, color="blue"),
    ),
)

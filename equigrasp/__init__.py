"""Language-conditioned equivariant grasping (LEG): steerable policies that turn with the object.

Importing the package costs no torch; import the parts by name, as in
`from equigrasp.policy import GraspPolicy`.
"""

from typing import Any

from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion, Workspace

__all__ = ["WORKSPACE", "Demonstration", "Grasp", "Motion", "Observation", "Workspace", "__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # costs as much as the rest of this package

        return version("equigrasp")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""Language-conditioned equivariant grasping (LEG): steerable policies that turn with the object.

Importing the package costs neither torch nor numpy; import the parts by name, as in
`from equigrasp.policy import GraspPolicy`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from equigrasp.grasp import Demonstration, Grasp, Observation
    from equigrasp.workspace import WORKSPACE, Motion, Workspace

__all__ = ["WORKSPACE", "Demonstration", "Grasp", "Motion", "Observation", "Workspace", "__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # costs more than this package

        return version("equigrasp")
    if name in ("Demonstration", "Grasp", "Observation"):
        return getattr(import_module("equigrasp.grasp"), name)
    if name in ("WORKSPACE", "Motion", "Workspace"):
        return getattr(import_module("equigrasp.workspace"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

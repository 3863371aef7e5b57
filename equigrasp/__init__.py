"""Language-conditioned equivariant grasping (LEG): steerable policies that turn with the object.

Importing the package costs no torch; import the parts by name, as in
`from equigrasp.policy import GraspPolicy`.
"""

from importlib.metadata import version

from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion, Workspace

__version__ = version("equigrasp")
__all__ = ["WORKSPACE", "Demonstration", "Grasp", "Motion", "Observation", "Workspace", "__version__"]

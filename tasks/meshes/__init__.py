"""Objects from meshes of your own (OBJ, STL, PLY, GLB, glTF, URDF) and folders of them; docs/objects.md says how."""

from tasks.meshes.library import mesh_folder
from tasks.meshes.mesh import MeshObject

__all__ = ["MeshObject", "mesh_folder"]

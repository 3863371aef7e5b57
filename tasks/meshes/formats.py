"""A file of any of the formats -> Source, by its ending: a URDF, or one mesh (`mesh_file`)."""

from __future__ import annotations

from pathlib import Path

from equigrasp.errors import InputError
from tasks.meshes import mesh_file, urdf
from tasks.meshes.source import Source

SUFFIXES = (".urdf", *mesh_file.MESHES)
"""Endings that are read here."""


def check_suffix(path: Path) -> None:
    """Refuse a file that is none of SUFFIXES."""
    if path.suffix.lower() not in SUFFIXES:
        known = ", ".join(suffix[1:].upper() for suffix in SUFFIXES)
        raise InputError(f"{path.name} is no format that is read here ({known}); convert it")


def references(path: Path, look: bool) -> list[Path]:
    """All files that a file needs besides itself, each once.

    Args:
        path: the file.
        look: whether materials and textures count.

    Raises:
        InputError: if it is of another format, or one is missing or lies outside the folder.
    """
    check_suffix(path)
    return (urdf if path.suffix.lower() == ".urdf" else mesh_file).references(path, look)


def read(path: Path, look: bool = True) -> Source:
    """Read a file as one rigid Source.

    Args:
        path: the file.
        look: whether to read its materials too.

    Raises:
        InputError: if it is missing, damaged, of another format, too large or without faces.
    """
    check_suffix(path)
    return (urdf if path.suffix.lower() == ".urdf" else mesh_file).read(path, look)

"""URDF: the visual shapes of its links, as they stand with all joints at zero, as one rigid Source."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from equigrasp.errors import InputError
from tasks.meshes import mesh_file
from tasks.meshes.reference import beside, read_bytes, read_image
from tasks.meshes.source import PLAIN, Source, joined, source

SHAPES = 200
"""No object has more visual shapes than this."""


def references(path: Path, look: bool) -> list[Path]:
    """The meshes that a URDF names, and what they name.

    Raises:
        InputError: if one is missing or lies outside the folder.
    """
    robot = _parse(path)
    found: list[Path] = []
    for mesh in robot.iter("mesh"):
        file = _mesh_file(path, mesh)
        found += [file, *mesh_file.references(file, look)]
    if look:
        found += [_texture_file(path, texture) for texture in robot.iter("texture")]
    return list(dict.fromkeys(found))


def read(path: Path, look: bool) -> Source:
    """Read a URDF: what is seen of each link, or what it collides by, where nothing is to be seen.

    Raises:
        InputError: if it is damaged, names a missing mesh or link, or its joints run in a circle.
    """
    robot = _parse(path)
    materials = {material.get("name", ""): material for material in robot.findall("material")}
    sources = []
    for link, where in _links(path, robot):
        for shape in link.findall("visual") or link.findall("collision"):
            geometry = shape.find("geometry")
            if geometry is None or not len(geometry):
                raise InputError(f"{path.name}: a shape of the link {link.get('name')!r} has no geometry")
            mesh = _shape(path, geometry[0], look)
            names = frozenset(filter(None, (link.get("name"), shape.get("name"))))
            material = shape.find("material")
            if look and material is not None:
                mesh = _painted(path, mesh, material, materials)
            mesh = replace(mesh, names=tuple(names | each for each in mesh.names))
            sources.append(mesh.moved(where @ _origin(path, shape)))
            if len(sources) > SHAPES:
                raise InputError(f"{path.name} has more than {SHAPES} shapes; an object has fewer")
    return joined(sources, path.name)


def _parse(path: Path) -> ElementTree.Element:
    content = read_bytes(path)
    # entities can make a file of a kilobyte unfold to gigabytes, and no URDF needs them
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content or len(content) > 20_000_000:
        raise InputError(f"{path.name} declares a document type or is too large; a plain URDF does neither")
    try:
        # PyBullet's own files say version 0.0, which XML does not know
        text = re.sub(r"^\s*<\?xml[^>]*\?>", "", content.decode("utf-8-sig", errors="replace"), count=1)
        robot = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{path.name} is no sound URDF: {error}; check its XML") from None
    if robot.tag != "robot":
        raise InputError(f"{path.name} is no URDF: its outermost element is <{robot.tag[:40]}>, not <robot>")
    return robot


def _mesh_file(path: Path, mesh: ElementTree.Element) -> Path:
    # package://name/meshes/x.obj -> meshes/x.obj, as the package's folder is where its URDF lies
    name = re.sub(r"^(package://[^/]+/|file://|model://[^/]+/)", "", mesh.get("filename", ""))
    file = beside(path, name, "mesh")
    if file.suffix.lower() not in mesh_file.MESHES:
        known = ", ".join(suffix[1:].upper() for suffix in mesh_file.MESHES)
        raise InputError(f"{path.name} names the mesh {name!r}; meshes are {known}")
    return file


def _texture_file(path: Path, texture: ElementTree.Element) -> Path:
    return beside(path, texture.get("filename", ""), "texture")


def _links(path: Path, robot: ElementTree.Element) -> list[tuple[ElementTree.Element, NDArray[np.float64]]]:
    """Each link and where it is `(4, 4)`, joints at zero."""
    links: dict[str, ElementTree.Element] = {}
    for link in robot.findall("link"):
        name = link.get("name", "")
        if name in links:
            raise InputError(f"{path.name} has two links called {name!r}")
        links[name] = link
    above: dict[str, tuple[str, NDArray[np.float64]]] = {}
    for joint in robot.findall("joint"):
        ends = [
            element.get("link", "") for element in (joint.find("parent"), joint.find("child")) if element is not None
        ]
        if len(ends) != 2 or not set(ends) <= set(links) or ends[1] in above:
            raise InputError(f"{path.name}: the joint {joint.get('name')!r} does not join two of its links")
        above[ends[1]] = (ends[0], _origin(path, joint))
    result = []
    for name, link in links.items():
        where, at, steps = np.eye(4), name, 0
        while at in above:
            at, transform = above[at]
            where = transform @ where
            steps += 1
            if steps > len(links):
                raise InputError(f"{path.name}: the joints above the link {name!r} run in a circle")
        result.append((link, where))
    return result


def _numbers(path: Path, text: str | None, default: str, count: int) -> list[float]:
    try:
        values = [float(word) for word in (default if text is None else text).split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(f"{path.name}: {text!r} should be {count} number{'s' * (count > 1)}")
    return values


def _origin(path: Path, element: ElementTree.Element) -> NDArray[np.float64]:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    roll, pitch, yaw = _numbers(path, origin.get("rpy"), "0 0 0", 3)
    result = np.eye(4)
    result[:3, 3] = _numbers(path, origin.get("xyz"), "0 0 0", 3)
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    result[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return result


def _shape(path: Path, geometry: ElementTree.Element, look: bool) -> Source:
    import trimesh

    if geometry.tag == "mesh":
        scale = np.eye(4)
        given = geometry.get("scale")
        # one number stands for three
        three = given if given is None or len(given.split()) != 1 else " ".join([given] * 3)
        factors = _numbers(path, three, "1 1 1", 3)
        if 0.0 in factors:
            raise InputError(f"{path.name} scales a mesh by {given!r}; no factor may be 0")
        scale[:3, :3] = np.diag(factors)
        return mesh_file.read(_mesh_file(path, geometry), look).moved(scale)
    if geometry.tag == "box":
        mesh = trimesh.creation.box(extents=_numbers(path, geometry.get("size"), "", 3))
    elif geometry.tag == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=4, radius=_numbers(path, geometry.get("radius"), "", 1)[0])
    elif geometry.tag in ("cylinder", "capsule"):
        radius, length = (_numbers(path, geometry.get(key), "", 1)[0] for key in ("radius", "length"))
        if radius <= 0.0 or length <= 0.0:
            raise InputError(f"{path.name} has a {geometry.tag} of radius {radius} and length {length}")
        if geometry.tag == "cylinder":
            mesh = trimesh.creation.cylinder(radius=radius, height=length, sections=64)
        else:
            mesh = trimesh.creation.capsule(radius=radius, height=length)
    else:
        raise InputError(
            f"{path.name} has the geometry <{geometry.tag[:40]}>; there are mesh, box, sphere and cylinder"
        )
    return source(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def _painted(path: Path, mesh: Source, material: ElementTree.Element, known: dict[str, ElementTree.Element]) -> Source:
    """With the URDF's colour where the mesh has none of its own, and with its texture."""
    if material.find("color") is None and material.find("texture") is None:
        material = known.get(material.get("name", ""), material)
    color, texture = material.find("color"), material.find("texture")
    colors, images, index = mesh.colors, mesh.images, mesh.texture
    if color is not None:
        rgb = np.clip(_numbers(path, color.get("rgba"), "", 4)[:3], 0.0, 1.0).astype(np.float32) * 255.0
        plain = (colors == np.array(PLAIN, dtype=np.float32)).all(axis=(1, 2))
        colors = np.where(plain[:, None, None], rgb, colors)
    if texture is not None:
        images, index = (*images, read_image(_texture_file(path, texture))), np.full_like(index, len(images))
    return replace(mesh, colors=colors, images=images, texture=index)

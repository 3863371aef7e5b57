"""Bake the objects: `python -m tasks.objects.bake [--out DIR] [names...]`.

Each shape becomes a coloured mesh (marching cubes, decimated), convex hulls for physics, and a few numbers.
What is baked ships in the package; running this again writes the same bytes. This needs the extra `bake`.
"""

from __future__ import annotations

import argparse
import io
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from equigrasp.artefacts import write_atomically
from tasks.objects import OBJECTS, drawing
from tasks.objects.asset import BAKED, PALETTE_SLOTS, baked_file
from tasks.objects.body import POKE, VOXEL, Samples, embody
from tasks.objects.paint import Faces, Vertices, cut_borders, cut_marks, slope
from tasks.objects.shape import COLOURS, Shape

FIRST_COLOURS = 15  # every mesh lists these, as the first ones baked did; of later ones as far as it uses them


def grid(shape: Shape) -> tuple[Samples, NDArray[np.float64]]:
    """Sample a shape on a cubic grid at VOXEL steps; and where, `(X, Y, Z, 3)` metres."""
    coarse = np.stack(np.meshgrid(*[np.arange(-0.16, 0.16, 0.005)] * 2, np.arange(-0.01, 0.12, 0.005)), axis=-1)
    near = coarse.reshape(-1, 3)[shape.distance(coarse.reshape(-1, 3)) < 0.008]
    # Half a voxel off, so that the flat base lies between two layers of the grid, not on one.
    low = np.floor(near.min(axis=0) / VOXEL - 1) * VOXEL - VOXEL / 2
    counts = np.ceil((near.max(axis=0) - low) / VOXEL).astype(int) + 2
    axes = [low[i] + VOXEL * np.arange(counts[i]) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return Samples(points[0, 0, 0], VOXEL, shape.distance(points.reshape(-1, 3)).reshape(points.shape[:3])), points


def visual_obj(vertices: Vertices, normals: Vertices, faces: Faces, colours: Sequence[int]) -> str:
    """The coloured mesh as OBJ text; face i takes slot `colours[i]` of the palette."""
    lines = ["mtllib palette.mtl", "usemtl palette"]
    lines += ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in vertices]
    lines += [f"vt {(slot + 0.5) / PALETTE_SLOTS:.6f} 0.5" for slot in range(max(FIRST_COLOURS, max(colours) + 1))]
    lines += ["vn {:.2f} {:.2f} {:.2f}".format(*n) for n in normals]
    for face, slot in zip((faces + 1).tolist(), colours, strict=True):
        lines.append("f " + " ".join(f"{v}/{slot + 1}/{v}" for v in face))
    return "\n".join(lines).replace("-0.0000", "0.0000") + "\n"


def collision_obj(pieces: list[tuple[Vertices, Faces]]) -> str:
    """The hulls as OBJ text, a group each: PyBullet loads it as a compound."""
    lines, start = [], 1
    for number, (vertices, faces) in enumerate(pieces):
        lines.append(f"o hull{number}")
        lines += ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in vertices]
        lines += ["f {} {} {}".format(*f) for f in faces + start]
        start += len(vertices)
    return "\n".join(lines).replace("-0.0000", "0.0000") + "\n"


def bake_palette(out: Path) -> None:
    """Write the colours that all objects share: `palette.png`, a square per slot, and its material."""
    pixels = np.zeros((8, 8 * PALETTE_SLOTS, 3), dtype=np.uint8)
    for slot, colour in enumerate(COLOURS.values()):
        pixels[:, 8 * slot : 8 * slot + 8] = colour
    picture = io.BytesIO()
    Image.fromarray(pixels).save(picture, format="PNG", optimize=False, compress_level=9)
    write_atomically(out / "palette.png", picture.getvalue())
    write_atomically(out / "palette.mtl", b"newmtl palette\nKa 1 1 1\nKd 1 1 1\nmap_Kd palette.png\n")


def bake(name: str, out: Path) -> dict[str, int]:
    """Bake one object into `out`: NAME.obj, NAME.hulls.obj, NAME.json. Returns its counts and bytes."""
    shape = drawing(name)
    samples, points = grid(shape)
    empty = points[samples.distances > POKE]
    body = embody(shape, samples, empty, shape.faces, shape.sectors)
    vertices, faces = cut_borders(shape, body.vertices, body.faces)
    vertices, faces = cut_marks(shape, vertices, faces)
    colours = shape.colour_at(vertices[faces].mean(axis=1)).tolist()
    normals, vertices = slope(shape, vertices), np.round(vertices - body.centre, 4)
    texts = {
        ".obj": visual_obj(vertices, normals, faces, colours),
        ".hulls.obj": collision_obj(body.pieces),
        ".json": json.dumps(body.numbers(vertices), separators=(",", ":")) + "\n",
    }
    for suffix, text in texts.items():
        write_atomically(baked_file(name, suffix, out), text.encode())
    return {"faces": len(faces), "hulls": len(body.pieces), "bytes": sum(len(text) for text in texts.values())}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tasks.objects.bake",
        description="Bake objects from their shapes. Example: python -m tasks.objects.bake --out baked mug",
    )
    parser.add_argument("names", nargs="*", help=f"default: all of {', '.join(OBJECTS)}")
    parser.add_argument("--out", type=Path, default=BAKED, help="folder to write to (default: the package's)")
    arguments = parser.parse_args()
    try:
        for name in arguments.names:
            drawing(name)
    except ValueError as unknown:
        parser.error(str(unknown))
    arguments.out.mkdir(parents=True, exist_ok=True)
    bake_palette(arguments.out)
    for name in arguments.names or OBJECTS:
        start = time.perf_counter()
        report = bake(name, arguments.out)
        print(
            f"{name:18} {time.perf_counter() - start:5.1f} s  {report['faces']:5} faces  "
            f"{report['hulls']:3} hulls  {report['bytes'] / 1024:6.1f} KiB",
            flush=True,
        )


if __name__ == "__main__":
    main()

"""Triangles to pixels: a depth buffer, a texture, and one light, as TinyRenderer shades them.

PyBullet's TinyRenderer draws the same pictures, but for the cameras at the sides, where it darkens surfaces by their
own shadow, asked for or not; `docs/benchmark.md` has the times of both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equigrasp.compiled import compiled
from tasks.surface import Surface


def draw(
    color: NDArray[np.uint8],
    depth: NDArray[np.float32],
    owner: NDArray[np.int32],
    body: int,
    surface: Surface,
    matrix: NDArray[np.float64],
    offset: NDArray[np.float64],
    light: NDArray[np.float64],
    ambient: float,
    diffuse: float,
) -> None:
    """Draw a surface into a picture, in place, wherever it is nearer than what is there.

    Pixel centres are whole numbers. Texture and normal are interpolated in the world, not in the picture; the
    texture is read at the nearest texel, and a pixel's colour is the texel's times `ambient + diffuse * cosine`.

    Args:
        color: `(h, w, 3)`.
        depth: `(h, w)` metres along the optical axis.
        owner: `(h, w)`.
        body: what becomes the owner of the pixels drawn.
        surface: in the object frame; all of it in front of the camera.
        matrix: `(3, 3)`; a point p is seen at `matrix @ p + offset`, which is (column, row, 1) times its depth.
        offset: `(3,)` metres.
        light: `(3,)` unit vector in the object frame to where the light comes from.
        ambient: share of the light that comes from everywhere.
        diffuse: share of the light that comes from `light`.
    """
    seen = surface.vertices @ matrix.T + offset
    shading = surface.normals, surface.texels, surface.texture, light, ambient, diffuse
    _draw(color, depth, owner, body, seen, surface.faces, *shading)


@compiled
def _draw(
    color: NDArray[np.uint8],
    depth: NDArray[np.float32],
    owner: NDArray[np.int32],
    body: int,
    seen: NDArray[np.float64],
    faces: NDArray[np.int32],
    normals: NDArray[np.float64],
    texels: NDArray[np.float32],
    texture: NDArray[np.uint8],
    light: NDArray[np.float64],
    ambient: float,
    diffuse: float,
) -> None:
    for vertex in seen:
        vertex[0] /= vertex[2]
        vertex[1] /= vertex[2]
    rows, columns = depth.shape
    last_row, last_column = texture.shape[0] - 1, texture.shape[1] - 1
    for face in range(len(faces)):
        a, b, c = faces[face]
        ax, ay, bx, by, cx, cy = seen[a, 0], seen[a, 1], seen[b, 0], seen[b, 1], seen[c, 0], seen[c, 1]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area >= 0.0:  # seen from inside, as rows go down, or edge on
            continue
        left, right = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), columns - 1)
        top, bottom = max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), rows - 1)
        for j in range(top, bottom + 1):
            for i in range(left, right + 1):
                p = ((bx - i) * (cy - j) - (cx - i) * (by - j)) / area
                q = ((cx - i) * (ay - j) - (ax - i) * (cy - j)) / area
                r = 1.0 - p - q
                if p < 0.0 or q < 0.0 or r < 0.0:
                    continue
                p, q, r = p / seen[a, 2], q / seen[b, 2], r / seen[c, 2]
                z = 1.0 / (p + q + r)
                if z >= depth[j, i]:
                    continue
                p, q, r = p * z, q * z, r * z
                depth[j, i], owner[j, i] = z, body
                x = p * normals[a, 0] + q * normals[b, 0] + r * normals[c, 0]
                y = p * normals[a, 1] + q * normals[b, 1] + r * normals[c, 1]
                up = p * normals[a, 2] + q * normals[b, 2] + r * normals[c, 2]
                cosine = (x * light[0] + y * light[1] + up * light[2]) / max(np.sqrt(x * x + y * y + up * up), 1e-12)
                shade = ambient + diffuse * max(cosine, 0.0)
                s = int(p * texels[face, 0, 0] + q * texels[face, 1, 0] + r * texels[face, 2, 0])
                t = int(p * texels[face, 0, 1] + q * texels[face, 1, 1] + r * texels[face, 2, 1])
                s, t = min(max(s, 0), last_column), min(max(t, 0), last_row)
                for channel in range(3):
                    color[j, i, channel] = min(int(shade * texture[t, s, channel]), 255)

"""What a file refers to: other files in its own folder, and nothing else. Text and pictures are read here."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from equigrasp.errors import InputError

LARGEST = 400_000_000
"""Bytes of a file."""
PIXELS = 100_000_000
"""Of a picture as it is."""
SIDE = 2048
"""Pixels, the longer side of a picture as it is kept: finer than any camera sees it."""


def read_bytes(path: Path) -> bytes:
    """The content of a file.

    Raises:
        InputError: if there is none, or it is too large.
    """
    try:
        if not path.is_file():
            raise InputError(f"there is no file {path}; check the path")
        size = path.stat().st_size
        if size > LARGEST:
            raise InputError(f"{path} has {size / 1e6:.0f} MB, and {LARGEST / 1e6:.0f} MB is the most; reduce the mesh")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None


def read_text(path: Path) -> str:
    """The content of a text file, without its mark of byte order; what is no text becomes a question mark."""
    return read_bytes(path).decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")


def beside(path: Path, name: str, what: str) -> Path:
    """The file that `path` refers to by `name`, in the folder of `path` or below it.

    Raises:
        InputError: if it lies elsewhere, or is not there.
    """
    clean = unquote(name.strip().strip('"')).replace("\\", "/")
    folder = path.parent.resolve()
    try:
        if "\0" in clean or "://" in clean or Path(clean).is_absolute() or clean[1:2] == ":":
            raise ValueError
        target = (folder / clean).resolve()
        if not target.is_relative_to(folder):
            raise ValueError
        there = target.is_file()
    except (ValueError, OSError, RuntimeError):
        raise InputError(
            f"{path.name} refers to the {what} {name[:80]!r} outside its own folder; put it beside and name it so"
        ) from None
    if not there:
        raise InputError(
            f"{path.name} names the {what} {name[:80]!r}, which is not there; put it beside it"
            + (", or pass color=" if what in ("material file", "texture") else "")
        )
    return target


def read_image(path: Path) -> NDArray[np.uint8]:
    """A picture as `(h, w, 3)` uint8, at most SIDE pixels long.

    Raises:
        InputError: if it is none that Pillow reads, or too large.
    """
    try:
        with Image.open(path) as image:
            return shrunk(image, path.name)
    except InputError:
        raise
    except Exception as error:  # Pillow's readers raise whatever comes to their minds
        raise InputError(f"the texture {path.name} cannot be read as a picture: {error}"[:300]) from None


def shrunk(image: Image.Image, what: str) -> NDArray[np.uint8]:
    """A picture as an array `(h, w, 3)`, at most SIDE pixels long."""
    if image.width * image.height > PIXELS:
        raise InputError(f"the texture {what} has {image.width}x{image.height} pixels; {SIDE} a side is plenty")
    rgb = image.convert("RGB")
    rgb.thumbnail((SIDE, SIDE))
    return np.asarray(rgb, dtype=np.uint8)

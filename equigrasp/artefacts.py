"""How results reach the disk: whole or not at all, and never over somebody else's files.

A file is written under a temporary name, flushed to the disk and renamed, so that a process killed at any
moment leaves the old file or the new one. A folder belongs to one plan (the arguments that made it): the same
plan may go on in it, another may not.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import json
import os
import shutil
import warnings
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equigrasp.errors import BusyError, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PARTIAL = ".partial-"
LONGEST_TAIL = 100
"""Bytes of a file's name in its partial's: a disk takes names of 255, and before the tail stand a number and more."""
LOCK = ".lock"
"""What whoever is at work in a folder holds."""
AGAIN = "delete it, and make it again"
"""The way out of a damaged file that can be."""


def write_atomically(path: Path, content: bytes) -> None:
    """Replace the file at `path` by `content`; a reader sees the old file or the new one, never a part.

    Of several writers at once the last one's content stays. A disk that is full keeps nothing of it.
    """
    partial = partial_name(path)
    try:
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except BaseException as error:
        partial.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)  # of a write nobody says where
        raise


def partial_name(path: Path) -> Path:
    """Where a file or folder lies until it is whole: beside its place, under a name that no other writer has."""
    return path.with_name(f"{PARTIAL}{os.getpid()}-{os.urandom(4).hex()}-{_tail(path)}")


def _tail(path: Path) -> str:
    """What a partial's name has of its file's: the end, with the suffix."""
    tail = os.fsencode(path.name)[-LONGEST_TAIL:]
    # from a whole letter of UTF-8 on, as some libraries take no path with a part of one
    return os.fsdecode(tail.lstrip(bytes(range(0x80, 0xC0))))


def write_json(path: Path, value: Any) -> None:
    """Write a value as JSON with sorted keys: the same value gives the same bytes."""
    write_atomically(path, (json.dumps(value, indent=1, sort_keys=True) + "\n").encode())


def write_figure(path: Path, figure: Figure, dpi: int, colors: int | None = None) -> None:
    """Write a figure as the path's ending says, PNG or PDF, whole or not at all.

    Args:
        path: PNG or PDF.
        figure: what is drawn.
        dpi: of the PNG.
        colors: how many the PNG has at most, for photographs: a third of the bytes.
    """
    content = io.BytesIO()
    with warnings.catch_warnings():
        # an instruction may have letters that the font lacks, and whoever looks sees their boxes
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from font")
        figure.savefig(content, format=path.suffix.removeprefix(".").lower(), dpi=dpi)
    if colors is not None and path.suffix.lower() == ".png":
        from PIL import Image

        from equigrasp.fewer_colors import fewer_colors

        drawn = Image.open(content)
        content = io.BytesIO()
        fewer_colors(drawn, colors).save(content, format="png", optimize=True)
    write_atomically(path, content.getvalue())


def append_line(path: Path, value: Any) -> None:
    """Add one JSON line to a file of results; a line that is there already is not doubled; writers take turns.

    Lines that are there stay as they are, whatever their encoding; of a link it is the file that it leads to.
    """
    path = Path(os.path.realpath(path))
    line = (json.dumps(value, sort_keys=True) + "\n").encode()
    with _turn(path.parent):
        old = path.read_bytes() if path.exists() else b""
        if old and not old.endswith(b"\n"):
            old += b"\n"
        if line not in old.splitlines(keepends=True):
            write_atomically(path, old + line)


def check_writable(path: Path, option: str, lines: bool = False) -> None:
    """Refuse a place where a file could not be written once the work for it is done.

    Args:
        path: the file.
        option: of the command line, that named it.
        lines: whether it is a file of results that gets one more line.

    Raises:
        InputError: if its folder is not there or cannot be written to, it is a folder itself or a device, or the last
            of its lines is not whole.
    """
    if lines:
        path = Path(os.path.realpath(path))
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent} for {option}; make it first")
    if path.is_dir():
        raise InputError(f"{option} is {path}, which is a folder; name a file")
    if path.exists() and not path.is_file():
        raise InputError(f"{option} is {path}, which is a device or a pipe, and a file would replace it; name a file")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path.parent} cannot be written to; choose another {option}")
    if lines and path.exists():
        last = path.read_bytes().rpartition(b"\n")[2]
        if last:
            try:
                json.loads(last)
            except ValueError:
                raise InputError(
                    f"the last line of {path} is not whole; delete it, or choose another {option}"
                ) from None


def check_readable(path: Path) -> None:
    """Raise an InputError where a file may not be read; what else is wrong with it is for its reader to say.

    safetensors says "No such file or directory" of such a file, which reads as if it were damaged.
    """
    try:
        path.open("rb").close()
    except PermissionError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); ask its owner, or change its mode") from None
    except OSError:
        return


def check_folder(folder: Path, option: str) -> None:
    """Raise an InputError if a folder could not be made, or not be written to, once the work for it is done."""
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(f"{existing} is a file, not a folder; choose another {option}")
    if not os.access(existing, os.W_OK):
        raise InputError(f"{existing} cannot be written to; choose another {option}")


@contextlib.contextmanager
def alone(folder: Path, what: str) -> Generator[None]:
    """Hold a folder that is there; a killed process lets go of it by dying.

    Raises:
        BusyError: if another process holds it, at the same kind of work: `what`.
    """
    with (folder / LOCK).open("w") as file:
        if not _lock(file, fcntl.LOCK_EX | fcntl.LOCK_NB):
            raise BusyError(f"another {what} is at work in {folder}; wait for it, or choose another --out")
        yield


@contextlib.contextmanager
def _turn(folder: Path) -> Generator[None]:
    """Wait until no other process adds to a file of the folder; a killed one lets go by dying."""
    place = os.open(folder, os.O_RDONLY)
    try:
        _lock(place, fcntl.LOCK_EX)
        yield
    finally:
        os.close(place)


def _lock(file: int | io.TextIOBase, how: int) -> bool:
    """Whether nobody else holds the file; on a disk without locks, as Lustre and NFS may be, nobody ever does."""
    with contextlib.suppress(OSError):
        try:
            fcntl.flock(file, how)
        except BlockingIOError:
            return False
    return True


def read_json(path: Path, what: str) -> dict[str, Any]:
    """Read a JSON object.

    Raises:
        InputError: if it cannot be read or is not a JSON object; `what` says what it should be.
    """
    try:
        value = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path} cannot be read as {what}: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{path} is damaged: it is not {what}; {AGAIN}") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} is damaged: it is not {what}; {AGAIN}")
    return value


def cache_folder(kind: str) -> Path:
    """Where things are kept that can be made again: a folder of $EQUIGRASP_CACHE, or of ~/.cache/equigrasp.

    Raises:
        InputError: if the one begins with another's home folder that is not there, or nobody knows this user's.
    """
    chosen = os.environ.get("EQUIGRASP_CACHE") or "~/.cache/equigrasp"
    try:
        return Path(chosen).expanduser() / kind
    except RuntimeError:
        raise InputError(
            f"nobody knows where {chosen} is, in which what can be made again is kept; set EQUIGRASP_CACHE to a folder"
        ) from None


def checksum(content: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def open_folder(folder: Path, plan_name: str, plan: Mapping[str, Any], megabytes: float) -> bool:
    """Make the folder for a plan, or find it begun by the same plan.

    Nothing is written before every check has passed; then `folder/plan_name` holds the plan.

    Args:
        folder: where the results will lie.
        plan_name: name of the JSON file that holds the plan.
        plan: the arguments that determine the results.
        megabytes: what the results will take at the most.

    Returns:
        Whether the plan was begun before.

    Raises:
        InputError: if the folder is a file, holds other things, belongs to another plan, cannot be written,
            or the disk has too little room.
    """
    check_folder(folder, "--out")
    contents = sorted(entry.name for entry in folder.iterdir()) if folder.exists() else []
    contents = [name for name in contents if not name.startswith(PARTIAL) and name != LOCK]
    begun = plan_name in contents
    if contents and not begun:
        raise InputError(f"{folder} holds other things ({contents[0]}, ...); choose another --out or empty it")
    if begun:
        old = read_json(folder / plan_name, "the plan of this folder")
        check_begun(folder, old, {**dict.fromkeys([*plan, *old]), **plan})
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free / 1e6
    if free < megabytes:
        raise InputError(
            f"{existing} has {free:.0f} MB free and {folder.name} may need {megabytes:.0f} MB; free some "
            "space or choose another --out"
        )
    if not begun:
        folder.mkdir(parents=True, exist_ok=True)
        with _turn(folder):
            if (folder / plan_name).exists():  # by another process, since it was looked for
                return open_folder(folder, plan_name, plan, megabytes)
            write_json(folder / plan_name, dict(plan))
    return begun


def check_begun(folder: Path, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    """Raise an InputError that names the first difference of a plan from what its folder was begun with.

    Args:
        folder: that was begun.
        old: the plan that it was begun with.
        new: what is now asked for, or a part of it.
    """
    # through JSON, so that tuples and lists compare as what they become on the disk
    for name, before, after in _differences(old, json.loads(json.dumps(dict(new)))):
        raise InputError(
            f"{folder} was begun with {name} {before!r:.200}, not {after!r:.200}; "
            "choose another --out, or go on with what it was begun with"
        )


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """Name and both values of what differs: names first, which say most, then in the new one's own order."""
    for key in sorted(new, key=lambda key: key != "name"):
        before, after = old.get(key), new[key]
        if isinstance(before, Mapping) and isinstance(after, Mapping):
            found = _differences(before, {**dict.fromkeys([*after, *before]), **after})
            yield from ((f"{key} {name}", *values) for name, *values in found)
        elif before != after:
            yield key, before, after


def remove_partials(folder: Path) -> None:
    """Delete what a killed process left half-written, and nothing that another one on this machine is writing."""
    for partial in folder.rglob(PARTIAL + "*"):
        if not _is_being_written(partial):
            partial.unlink(missing_ok=True)


def remove_partials_of(path: Path) -> None:
    """Delete what killed processes left of one file or folder that they would have made there, and nothing else."""
    for partial in path.parent.glob(PARTIAL + "*"):
        theirs = partial.name.removeprefix(PARTIAL).split("-", 2)[2:]
        if theirs != [_tail(path)] or _is_being_written(partial):
            continue
        if partial.is_dir():
            shutil.rmtree(partial, ignore_errors=True)
        else:
            partial.unlink(missing_ok=True)


def _is_being_written(partial: Path) -> bool:
    """Whether a living process other than this one has the number in a partial's name."""
    number = partial.name.removeprefix(PARTIAL).partition("-")[0]
    if not number.isdecimal() or int(number) == os.getpid():
        return False
    try:
        with contextlib.suppress(PermissionError):  # another user's
            os.kill(int(number), 0)
    except (ProcessLookupError, OverflowError):
        return False
    return True

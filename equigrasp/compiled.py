"""Functions compiled by numba, whose machine code is kept on disk between processes, and never another function's."""

from __future__ import annotations

import contextlib
import glob
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with numba; keep the machine code on disk, or in memory where nothing can be written.

    What is on disk is compiled anew when the function's own file changes, and not when the value of a global does: a
    number that another file has comes as an argument. `tests/test_compiled.py` holds every compiled function to that.
    """
    dispatcher = numba.njit(function)
    with contextlib.suppress(RuntimeError):  # numba found no directory that it may write its cache to
        dispatcher._cache = _FunctionCache(function)  # ty: ignore[missing-attribute]
    return dispatcher


class _FunctionCache(FunctionCache):
    """numba's, but that a full disk or a damaged file costs a compilation and nothing more."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _Files(self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was kept for a signature; None where there is nothing of it, or nothing that can be read."""
        # whatever unpickling a part of a file raises
        with contextlib.suppress(Exception):
            return super().load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it; where that cannot be done it is in memory all the same."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


class _Files(IndexDataCacheFile):
    """An index, and a file for each signature with a name that no other source, signature or numba has.

    numba numbers them, and writes the index first: where a full disk or a kill comes between, the index of today's
    source names yesterday's machine code, and so it may after two processes that compiled two signatures at once.
    """

    def __init__(self, folder: str, base: str, source: Any) -> None:
        super().__init__(folder, base, source)
        self.folder, self.base, self.source = Path(folder), base, source

    def save(self, key: Any, data: Any) -> None:
        """Add one to the index when it is there; delete what is of another source."""
        name = f"{self.base}.{hashlib.sha256(repr((numba.__version__, self.source, key)).encode()).hexdigest()}.nbc"
        self._save_data(name, data)
        overloads = {**self._load_index(), key: name}
        self._save_index(overloads)
        for old in self.folder.glob(f"{glob.escape(self.base)}.*.nbc"):
            if old.name not in overloads.values():
                old.unlink(missing_ok=True)

    def _load_index(self) -> dict[Any, str]:
        # a damaged one is none: it is written anew
        with contextlib.suppress(Exception):
            return super()._load_index()
        return {}

"""Modules that a library imports at its start and that nobody here calls: imported when they are called."""

from __future__ import annotations

import contextlib
import importlib.util
import pkgutil
import sys
from collections.abc import Generator
from types import ModuleType
from typing import Any


class Late(ModuleType):
    """A name within a module that is imported when the name is called, and not before.

    Its attributes are names too: `Late("scipy.stats").ortho_group.rvs(3)` imports `scipy.stats` and calls
    `ortho_group.rvs` of it.
    """

    def __getattr__(self, name: str) -> Late:
        if name.startswith("__"):
            raise AttributeError(name)
        return Late(f"{self.__name__}.{name}")

    def __call__(self, *args: Any, **named: Any) -> Any:
        """What the function or class of this name makes of them, called within `late` or after it."""
        _forget()
        return pkgutil.resolve_name(self.__name__)(*args, **named)


@contextlib.contextmanager
def late(*modules: str) -> Generator[None]:
    """Whoever imports one of these modules within it has them `Late`; afterwards an import is an import again.

    A module that is there already, or whose package is not installed, is left to the import.
    """
    for name in modules:
        package, _, inside = name.partition(".")
        spec = None if name in sys.modules else importlib.util.find_spec(package)
        if spec is None:
            continue
        sys.modules[name] = Late(name)
        if not inside:
            # whoever asks whether it is installed, asks this
            sys.modules[name].__spec__ = spec
    try:
        yield
    finally:
        _forget()


def _forget() -> None:
    for name in [name for name, module in sys.modules.items() if isinstance(module, Late)]:
        del sys.modules[name]

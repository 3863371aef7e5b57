"""lie_learn's circle transform and groups: the independent reference, made importable.

Its SE2 module imports `spaces.Rn` by a name from before the package had a prefix, so it is given one for the time of
that import.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from types import ModuleType
from typing import Any


def _import(name: str) -> Any:
    with warnings.catch_warnings():
        # compiling lie_learn for the first time warns of its docstrings' backslashes
        warnings.simplefilter("ignore")
        return importlib.import_module(name)


def _import_se2() -> Any:
    spaces, line = ModuleType("spaces"), _import("lie_learn.spaces.rn")
    spaces.Rn = line  # ty: ignore[missing-attribute]
    names = {"spaces": spaces, "spaces.Rn": line}
    before = {name: sys.modules.get(name) for name in names}
    sys.modules.update(names)
    try:
        return _import("lie_learn.groups.SE2")
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


T1FFT = _import("lie_learn.spectral.T1FFT").T1FFT
"""The Fourier transform on the circle."""
SO2 = _import("lie_learn.groups.SO2")
SE2 = _import_se2()

"""Things of a user's own by their name in Python: "my_package.my_module:name", as console scripts are named."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from equigrasp.artefacts import checksum
from equigrasp.errors import InputError, unknown


def attribute(name: str, what: str, example: str) -> Any:
    """Import what a "module:name" stands for; the working folder is importable, as with `python -m`.

    Args:
        name: the module's name and the attribute's.
        what: what it should be, for the message: "a policy".
        example: an attribute's name, for the message: "make".

    Raises:
        InputError: if that cannot be: the form, the module, or the name in it.
    """
    module_name, _, wanted = name.partition(":")
    if not module_name or not wanted:
        raise InputError(f"{what} is given as my_package.my_module:{example}, but this is {name!r}")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise InputError(f"{module_name!r} cannot be imported ({error}); is it installed, or in this folder?") from None
    except Exception as error:  # the module's own code
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise InputError(f"{module_name!r} cannot be imported: its own code raises {reason}; mend it first") from None
    try:
        return getattr(module, wanted)
    except AttributeError:
        public = [each for each in vars(module) if not each.startswith("_")]
        raise unknown(f"name in {module_name}", wanted, public or ["nothing public"]) from None


def checksum_of(module: str) -> str:
    """The checksum of an imported module's file as it is now; of nothing, where it has none."""
    path = getattr(sys.modules.get(module), "__file__", None)
    return checksum(Path(path).read_bytes() if path and Path(path).is_file() else b"")

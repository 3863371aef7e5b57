"""The settings of models as JSON has them: whether a value is of the type that its config declares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from equigrasp.errors import InputError

KINDS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "str": ("a string", lambda value: isinstance(value, str)),
    "bool": ("true or false", lambda value: isinstance(value, bool)),
    "int": ("a whole number", lambda value: type(value) is int),
    "float | None": ("a number or null", lambda value: value is None or type(value) in (int, float)),
    "tuple[int, ...]": (
        "a list of whole numbers",
        lambda value: isinstance(value, tuple) and all(type(each) is int for each in value),
    ),
}
"""A setting's type -> how it is called, and whether a value read from JSON is of it, where True is no number."""


def check_setting(name: str, value: Any, kind: str) -> None:
    """Raise an InputError unless a model's setting is of its type, a key of `KINDS`; lists are tuples by now."""
    said, is_one = KINDS[kind]
    if not is_one(value):
        raise InputError(
            f"a model's {name} is {said}, but this one's is {value!r:.100}; put the right one into its config.json, or "
            "save it again"
        )

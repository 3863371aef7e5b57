"""What an instruction asks for."""

from __future__ import annotations

from dataclasses import dataclass

from equigrasp.errors import InputError

_SUCH_AS = {"object": "mug", "part": "handle", "color": "red", "kind": "by part"}


@dataclass(frozen=True)
class Goal:
    """An object, perhaps of a colour, perhaps by a part of it.

    Attributes:
        object: the object's name, as in `tasks.objects.OBJECTS` or among a task's own objects.
        part: the part to take it by, or None where any part will do.
        color: what it is painted, a name in `tasks.objects.PAINTS`, or None for its own look.
        kind: which grammar speaks of it, a key of `tasks.instructions.GRAMMARS` or of the task's own grammars;
            left empty: "by part", "colored object" or "object", as part and colour are given.

    Raises:
        InputError: if one of these is no string, or the object is missing.
    """

    object: str
    part: str | None = None
    color: str | None = None
    kind: str = ""

    def __post_init__(self) -> None:
        for field, name in _SUCH_AS.items():
            value = getattr(self, field)
            if not isinstance(value, str) and (value is not None or field == "object"):
                raise InputError(f"a goal's {field} is a name such as {name!r}, but this is {value!r:.100}")
        if not self.kind:
            kind = "by part" if self.part else "colored object" if self.color else "object"
            object.__setattr__(self, "kind", kind)

    @property
    def name(self) -> str:
        """What the thing is called in a scene: "mug", or "blue mug"."""
        return self.object if self.color is None else f"{self.color} {self.object}"

    def __str__(self) -> str:
        return self.name if self.part is None else f"{self.name} by {self.part}"

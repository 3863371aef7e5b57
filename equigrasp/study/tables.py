"""The paper's tables as rows of one dict, and which tasks a policy is tested on."""

from __future__ import annotations

from dataclasses import dataclass

V1 = ("pick-colored-ell", "pick-fruit", "pick-tool", "pick-toy", "pick-caption", "pick-logo")
V2 = ("pick-colored-fruit", "pick-colored-tool", "pick-colored-toy")

TESTED_ON: dict[str, tuple[str, ...]] = {
    "pick-random-v1": (*V1, "pick-random-v1"),
    "pick-random-v2": (*V2, "pick-random-v2", "pick-novel-v2"),
}
"""A task that is trained on -> the tasks that such a policy is tested on; any other task is tested on itself."""

PAPER_MODELS = ("leg-unet", "leg-cliport", "fcgq", "vit", "cliport-rn50", "cliport-vit", "cliport-rotator")


@dataclass(frozen=True)
class Table:
    """One of the paper's tables.

    Attributes:
        title: what it shows.
        models: its rows.
        tasks: what is trained on; none for a table of costs.
    """

    title: str
    models: tuple[str, ...]
    tasks: tuple[str, ...]


TABLES: dict[int, Table] = {
    1: Table("the V-1 tasks", PAPER_MODELS, ("pick-random-v1",)),
    2: Table("the V-2 tasks, and combinations that no training shows", PAPER_MODELS, ("pick-random-v2",)),
    4: Table(
        "ablations of leg-unet",
        ("leg-unet", "leg-unet-no-kernel-language", "leg-unet-no-steerability", "leg-unet-no-phi-language"),
        ("pick-random-v1", "pick-random-v2", "pick-by-part"),
    ),
    5: Table("parameters and the time of a step", PAPER_MODELS, ()),
    6: Table("an object by one of its parts", ("leg-unet", "fcgq", "vit"), ("pick-by-part",)),
}
"""The paper's tables, by number."""

"""The paper's own figures, as far as they are known here; every other one is left blank, and never guessed.

Its parameters stand with the models (`equigrasp.models`, `paper_parameters`).
"""

from __future__ import annotations

STEPS = 40_000
"""Of its training."""

REWARDS: dict[int, dict[tuple[str, int], dict[str, float]]] = {
    6: {
        ("leg-unet", 1): {"pick-by-part": 87.0},
        ("leg-unet", 10): {"pick-by-part": 98.0},
        ("fcgq", 1): {"pick-by-part": 66.0},
        ("fcgq", 10): {"pick-by-part": 95.0},
        ("vit", 1): {"pick-by-part": 19.5},
        ("vit", 10): {"pick-by-part": 53.0},
    }
}
"""Table -> model and demonstrations -> task -> mean reward, percent, by its own objects and cameras."""

COST = "0.12 s a step and 2.6 GB, on an RTX 3090"
"""What it says of training; for which of its models is not known here."""

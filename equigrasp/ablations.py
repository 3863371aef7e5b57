"""The paper's ablations (Table 4): each row is one `replace` of the full model, and the difference is the row."""

from __future__ import annotations

from dataclasses import replace

from equigrasp.config import LegConfig


def ablations(full: LegConfig) -> tuple[LegConfig, ...]:
    """The full model without language in its kernel, without steerability, without language in phi."""
    ablated = replace(full, paper_parameters=None)
    return (
        replace(
            ablated,
            name=f"{full.name}-no-kernel-language",
            summary=f"{full.name} whose kernel is one trained vector's, the same for every instruction",
            kernel_language=False,
        ),
        replace(
            ablated,
            name=f"{full.name}-no-steerability",
            summary=f"{full.name} whose kernel is generated channel by channel, without the lift",
            kernel="plain",
        ),
        replace(
            ablated,
            name=f"{full.name}-no-phi-language",
            summary=f"{full.name} whose features are the same for every instruction",
            phi_language=False,
        ),
    )

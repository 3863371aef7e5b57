"""Why a law says nothing: about a subject, before anything is measured, or where no case of it could be measured."""

from __future__ import annotations

from equivariance_tests.subjects import KernelSubject, PolicySubject, turns_as_waves

TIES = "no case of it could be measured, the best grasp being at several cells at once"
TURNS_OR_TIES = TIES + ", or its group having none of these turns"
NO_QUARTER_TURN = (
    "no case of it could be measured, scores of a cell being off at quarter turns about it as well, or none of them "
    "depending on what is there"
)
FARTHEST = 160.0
"""Pixels: half of the table. What sees further is as good as global, and the scenes of its laws would be huge."""


def needs_bins(subject: KernelSubject) -> str | None:
    """Of laws about scores over angles."""
    if subject.read_out is not None:
        return None
    return "its out_type is not fields.even_type and it has no read_out (bins, out_type.size)"


def needs_waves(subject: KernelSubject) -> str | None:
    """Of laws about scores that are a Fourier series."""
    if subject.read_out is not None and not turns_as_waves(subject.out_type):
        return "its out_type is not a constant and then the waves of 2, 4, .. in this order"
    return needs_bins(subject)


def needs_reach(subject: PolicySubject) -> str | None:
    """Of laws about what a score sees."""
    if subject.reach is None:
        return "it has no reach (pixels, how far a score sees along each axis)"
    if subject.reach > FARTHEST:
        return f"its scores see {subject.reach:g} pixels far, and what is beyond {FARTHEST:g} is not looked at"
    return None


def needs_all_turns(subject: PolicySubject) -> str | None:
    """Of laws about turns that a grid does not have."""
    if subject.declared:
        return f"its types are over C_{subject.declared}, and the turns of a grid are those of 'policy: quarter turn'"
    return None

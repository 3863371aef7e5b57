"""LAWS: every law as one row. What it says, where it is from, on what it is measured, and what may be left of it.

Tolerances are set between what sound modules measure and what broken ones do; `docs/equivariance.md` has both.
"""

from __future__ import annotations

from equivariance_tests import grasp_laws, group_laws, kernel_laws, local_laws
from equivariance_tests.law import Law, both, by_dtype
from equivariance_tests.scenes import HALF_BAND, QUARTER_BAND
from equivariance_tests.subjects import ActionSubject, KernelSubject, LiftSubject, PolicySubject, turns_as_waves


def _needs_bins(subject: KernelSubject) -> str | None:
    if subject.read_out is not None:
        return None
    return "its out_type is not fields.even_type and it has no read_out (bins, out_type.size)"


def _needs_waves(subject: KernelSubject) -> str | None:
    if subject.read_out is not None and not turns_as_waves(subject.out_type):
        return "its out_type is not a constant and then the waves of 2, 4, .. in this order"
    return _needs_bins(subject)


FARTHEST = 160.0
"""Pixels: half of the table. What sees further is as good as global, and the scenes of its laws would be huge."""


def _needs_reach(subject: PolicySubject) -> str | None:
    if subject.reach is None:
        return "it has no reach (pixels, how far a score sees along each axis)"
    if subject.reach > FARTHEST:
        return f"its scores see {subject.reach:g} pixels far, and what is beyond {FARTHEST:g} is not looked at"
    return None


LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        # the groups and how they act
        Law(
            "group",
            "T_g T_h = T_gh and T_g T_(g^-1) = 1, as lie_learn's SE(2)",
            "definition of a group action",
            ActionSubject,
            "any",
            both(1e-12),
            group_laws.group,
        ),
        Law(
            "grasps move",
            "T_g (x, theta) = (g x, theta + alpha modulo pi)",
            "definition of the action on grasps",
            ActionSubject,
            "any",
            both(1e-10),
            group_laws.grasps,
        ),
        Law(
            "observations move",
            "(T_g o)(p) = o(g^-1 p); height is a scalar",
            "definition of the action on observations",
            ActionSubject,
            "quarter",
            both(1e-4),
            group_laws.observations,
        ),
        # the lift
        Law(
            "lift permutes",
            "L(g x)_j = L(x)_(j - g) at quarter turns, pixel by pixel",
            "A.2.3",
            LiftSubject,
            "quarter",
            both(1e-12),
            group_laws.lift_permutes,
        ),
        Law(
            "lift turns",
            "L(g x)_j = L(x)_(j - g) for every g in C_n and a smooth psi",
            "A.2.3",
            LiftSubject,
            "bin",
            both(2e-2),
            group_laws.lift_turns,
        ),
        # angles
        Law(
            "mirror",
            "rho_out(pi) = 1: the gripper is its own mirror",
            "theta modulo pi",
            KernelSubject,
            "quarter",
            both(1e-12),
            kernel_laws.mirror,
            count=1,
        ),
        Law(
            "fourier",
            "bin i is the score at i pi / bins: lie_learn's T1FFT",
            "inverse Fourier transform",
            KernelSubject,
            "bin",
            by_dtype(1e-5, 1e-12),
            kernel_laws.fourier,
            applies=_needs_waves,
        ),
        Law(
            "bins turn",
            "read_out rho(g) = shift(g) read_out for turns by whole bins",
            "inverse Fourier transform",
            KernelSubject,
            "bin",
            by_dtype(1e-5, 1e-12),
            kernel_laws.bins_turn,
            applies=_needs_bins,
        ),
        # the kernel
        Law(
            "lemma 1",
            "K(g^-1 x) = rho_out(g)^-1 K(x) at quarter turns, tap by tap",
            "Lemma 1",
            KernelSubject,
            "quarter",
            by_dtype(1e-5, 1e-12),
            kernel_laws.lemma_1,
        ),
        Law(
            "steerability",
            "K(g x) = rho_out(g) K(x) at any turn, seen by waves up to a quarter of Nyquist",
            "Eq. 7",
            KernelSubject,
            "any",
            both(2e-4),
            kernel_laws.steerability(QUARTER_BAND),
            count=40,
        ),
        Law(
            "steerability, wide band",
            "K(g x) = rho_out(g) K(x) at any turn, seen by waves up to half of Nyquist",
            "Eq. 7",
            KernelSubject,
            "any",
            both(1e-3),
            kernel_laws.steerability(HALF_BAND),
            count=40,
        ),
        # the correlation
        Law(
            "correlation",
            "(K * o)(x) = sum over w of K(w) o(x + w)",
            "definition of the correlation",
            KernelSubject,
            "quarter",
            by_dtype(1e-5, 1e-12),
            kernel_laws.correlation,
            count=4,
        ),
        Law(
            "translation",
            "f(T_t o) = T_t f(o) for every translation t",
            "Eq. 2",
            KernelSubject,
            "any",
            by_dtype(1e-5, 1e-12),
            kernel_laws.translation,
            count=4,
        ),
        Law(
            "lemma 2",
            "(T_g K) * (T_g o) = T_g (K * o) at quarter turns, pixel by pixel",
            "Lemma 2",
            KernelSubject,
            "quarter",
            by_dtype(1e-5, 1e-12),
            kernel_laws.lemma_2,
            count=4,
        ),
        Law(
            "equivariance",
            "f(T_g o) = T_g rho_out(g) f(o) at any turn, through the correlation",
            "Proposition 1",
            KernelSubject,
            "any",
            both(2e-4),
            kernel_laws.equivariance,
        ),
        # the grasp
        Law(
            "eq. 2, whole bins",
            "argmax f(o with g.b) = g argmax f(o): the target alone turns by whole bins",
            "Eq. 2, Proposition 1",
            KernelSubject,
            "bin",
            both(1.0),
            grasp_laws.eq_2_kernel,
            "cells or bins",
            count=24,
            applies=_needs_bins,
        ),
        Law(
            "eq. 2, any turn",
            "argmax f(o with g.b) = g argmax f(o): the target alone turns by any angle",
            "Eq. 2, Proposition 1",
            KernelSubject,
            "any",
            both(1.5),
            grasp_laws.eq_2_kernel,
            "cells or bins",
            count=24,
            applies=_needs_bins,
        ),
        # whole policies
        Law(
            "policy: quarter turn",
            "f(T_g o) = T_g rho(g) f(o) for quarter turns of the whole scene, every score",
            "Proposition 1",
            PolicySubject,
            "quarter",
            by_dtype(1e-4, 1e-10),
            grasp_laws.quarter_turn,
            count=6,
        ),
        Law(
            "policy: translation",
            "the best grasp of an object moves with it by multiples of 32 pixels",
            "Eq. 2",
            PolicySubject,
            "quarter",
            both(1.0),
            grasp_laws.translation,
            "cells or bins",
            count=6,
        ),
        Law(
            "policy: eq. 2, quarter turns",
            "the best grasp of the target follows it when it alone turns by quarter turns",
            "Eq. 2, Proposition 1",
            PolicySubject,
            "quarter",
            both(1.0),
            grasp_laws.eq_2_policy,
            "cells or bins",
            count=12,
        ),
        Law(
            "policy: eq. 2, any turn",
            "the best grasp of the target follows it when it alone turns by any angle",
            "Eq. 2, Proposition 1",
            PolicySubject,
            "any",
            both(1.5),
            grasp_laws.eq_2_policy,
            "cells or bins",
            count=12,
        ),
        Law(
            "policy: field of view",
            "f(o)(x) depends on o within reach of x alone: others beyond it may go",
            "condition 3 of Eq. 2",
            PolicySubject,
            "quarter",
            by_dtype(1e-4, 1e-12),
            local_laws.field_of_view,
            count=6,
            applies=_needs_reach,
        ),
        Law(
            "policy: eq. 2, every score",
            "the target alone turns by quarter turns: scores that see it alone turn, those that do not see it stay",
            "Eq. 2, Proposition 1",
            PolicySubject,
            "quarter",
            by_dtype(1e-4, 1e-12),
            local_laws.eq_2_field,
            applies=_needs_reach,
        ),
    )
}

"""kappa(l): from the embedding of an instruction to a kernel that turns scalars into scores over angles.

Every kernel K(l) here is a field on the pixel grid whose type is declared by `in_type` (scalars) and `out_type`
(even irreps). A steerable one obeys, up to its own measured error, the steerability constraint of LEG (Eq. 7, the
lemma behind Eq. 2), written for world y up:

    K(g x) = rho_out(g) K(x)        for every rotation g about the kernel's centre.

Correlating phi(o) with it then gives a field that turns with the scene, f(T_g o) = T_g rho_out(g) f(o).
Its frequencies being even, a half turn does not change it, K(-x) = K(x); it says so by `even`, and is correlated by a
shorter route (`equigrasp.correlation`). Embeddings are `(B, D)` of unit length; kernels are
`(B, out_type.size, C, k, k)`, rows first, row 0 at the top.
"""

from equigrasp.kernel.lifted import LiftedKernel
from equigrasp.kernel.plain import PlainKernel
from equigrasp.kernel.steerable import SteerableKernel

__all__ = ["LiftedKernel", "PlainKernel", "SteerableKernel"]

"""Policies: scores over pixels and angles, and the one way in which all of them are read out and act.

    observation, instruction -> scores: 36 bins at each cell -> argmax -> Grasp

`LegPolicy` is the method: phi(o, l) correlated with kappa(l) (LEG, Eq. 1 and 2). `DensePolicy` is any network that
puts out the scores itself, as the baselines do. Training, evaluation and laws ask for a `GraspPolicy` and no more.
"""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from equigrasp import fields, language
from equigrasp.constant import Constant
from equigrasp.correlation import Correlation, correlation_of
from equigrasp.errors import InputError, unknown
from equigrasp.freed_memory import keep_freed_memory
from equigrasp.grasp import Grasp, Observation
from equigrasp.kept import Kept
from equigrasp.kernel.inputs import check_dtypes, check_fit, dtype_of
from equigrasp.precision import PRECISIONS, multiplies_bfloat16
from equigrasp.read_out import ReadOut
from equigrasp.sharing.shareable import Shareable
from equigrasp.workspace import WORKSPACE

if TYPE_CHECKING:
    from typing_extensions import Self


class GraspPolicy(nn.Module, Shareable, ABC):
    """f(o, l): a score for every cell of the read-out and every angle of the closing axis.

    A subclass says how `score` is computed, and nothing else. `save_pretrained`, `from_pretrained` and `push_to_hub`
    are `Shareable`'s.

    Args:
        stride: heightmap pixels a cell.
        text_encoder: a name from `language.ENCODERS`.
        precision: "bfloat16" runs `score` under autocast; "auto" does where the hardware multiplies bfloat16
            (`equigrasp.precision`). Scores and loss are always float32.
        bins: angles in [0, pi) that are scored; bin i lies at i pi / bins. The workspace's 36 but for `LegPolicy.at`.
    """

    def __init__(
        self, stride: int, text_encoder: str = "minilm", precision: str = "auto", bins: int = WORKSPACE.bins
    ) -> None:
        super().__init__()
        if precision not in PRECISIONS:
            raise unknown("precision", precision, PRECISIONS)
        self.stride = stride
        self.text_encoder = text_encoder
        self.embedding_size = language.width(text_encoder)
        self.precision = precision
        self.bins = bins
        self._kept = Kept()

    @abstractmethod
    def score(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Scores `(B, bins, H / stride, W / stride)`, of any floating dtype; under autocast where `precision` says so.

        Args:
            observation: `(B, 4, H, W)`, as `to_tensor` makes it.
            embedding: `(B, D)`, the instruction's.
        """

    def logits(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Scores `(B, bins, H / stride, W / stride)` float32 (float64 for observations in float64).

        Args:
            observation: `(B, 4, H, W)` float32 as `to_tensor` makes it, sides multiples of 32.
            embedding: `(B, D)` float32, the instruction's.

        Raises:
            InputError: if the shapes do not go together, or the scores have another one.
        """
        self._check(observation, embedding)
        device = observation.device.type
        with torch.autocast(device, torch.bfloat16, enabled=multiplies_bfloat16(self.precision, device)):
            scores = self.score(observation, embedding)
        self._check_scores(scores, observation)
        return scores.to(torch.promote_types(observation.dtype, torch.float32))

    forward = logits

    def log_probabilities(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """The log of p(bin, row, column), over all cells of the read-out together; shape as `logits`."""
        logits = self.logits(observation, embedding)
        return logits.flatten(1).log_softmax(dim=1).view_as(logits)

    def act(self, observation: Observation, instruction: str) -> Grasp:
        """The best grasp, in full-resolution pixels: the best cell and bin, refined by a parabola along each axis.

        In evaluation mode the instruction's embedding and kernel are kept until the weights change (`equigrasp.kept`).
        """
        return self.act_many([observation], [instruction])[0]

    @torch.no_grad()
    def act_many(self, observations: Sequence[Observation], instructions: Sequence[str]) -> list[Grasp]:
        """The best grasp of each scene for its instruction, all scored as one batch, in the parameters' own dtype.

        The process keeps what memory it frees from then on (`equigrasp.freed_memory`).

        Raises:
            InputError: if their numbers or the scenes' shapes differ, one is no `Observation`, an instruction is empty,
                or no score is the best.
        """
        if len(observations) != len(instructions):
            raise InputError(
                f"each scene has its instruction, but these are {len(observations)} scenes and "
                f"{len(instructions)} instructions"
            )
        if not observations:
            return []
        for each in observations:
            if not isinstance(each, Observation):
                raise InputError(
                    f"a policy acts on an equigrasp.grasp.Observation, but this is a {type(each).__name__}; of an "
                    "environment pass env.unwrapped.observation"
                )
        shapes = {each.shape for each in observations}
        if len(shapes) > 1:
            raise InputError(f"scenes of one batch have one shape, but these are {sorted(shapes)}; act on each alone")
        keep_freed_memory()
        training = self.training
        with evaluating(self) if training else contextlib.nullcontext():
            embedding = self._heard(tuple(instructions), keep=not training)
            batch = torch.stack([to_tensor(each) for each in observations])
            scores = self.logits(batch.to(embedding), embedding).cpu().numpy()
        # minus infinity is what a policy forbids
        if not np.isfinite(scores.max(axis=(1, 2, 3))).all():
            raise InputError(f"{type(self).__name__} makes scores of which none is the best; are its weights NaN?")
        read_out = self.read_out(observations[0].shape)
        return [read_out.best(each) for each in scores]

    def _heard(self, instructions: tuple[str, ...], keep: bool) -> Tensor:
        """Their embeddings `(B, D)`; with `keep`, the tensor by which `LegPolicy` knows their kernels."""
        dtype = dtype_of(self) or torch.float32

        def embeddings() -> Tensor:
            return torch.stack([self.embed(each) for each in instructions]).to(dtype)

        if not keep:
            return embeddings()
        device = getattr(next(self.parameters(), None), "device", None)
        settings = self.precision, language.identify(self.text_encoder), device, dtype
        return self._kept.embedding(instructions, getattr(self, "kappa", None), settings, embeddings)

    def train(self, mode: bool = True) -> Self:
        """As `nn.Module.train`; what acting has kept is forgotten."""
        if mode:
            self._kept.clear()
        return super().train(mode)

    def embed(self, instruction: str) -> Tensor:
        """The instruction's embedding `(D,)` float32, computed once and kept (`equigrasp.language`)."""
        vector = language.embed(self.text_encoder, [instruction])[0]
        weight = next(self.parameters(), None)
        return torch.from_numpy(vector).to("cpu" if weight is None else weight.device)

    def read_out(self, shape: tuple[int, int]) -> ReadOut:
        """How cells of the read-out and grasps correspond, for heightmaps of that shape (H, W)."""
        return ReadOut(shape[0] // self.stride, shape[1] // self.stride, self.stride, self.bins)

    def _check(self, observation: Tensor, embedding: Tensor) -> None:
        if embedding.ndim != 2 or embedding.shape[1] != self.embedding_size:
            raise InputError(
                f"embeddings of {self.text_encoder!r} are (B, {self.embedding_size}), "
                f"but this is {tuple(embedding.shape)}"
            )
        if observation.ndim != 4 or len(observation) != len(embedding):
            raise InputError(
                f"observations are (B, 4, H, W) and one embedding goes with each, but these are "
                f"{tuple(observation.shape)} and {tuple(embedding.shape)}"
            )

    def _check_scores(self, scores: Tensor, observation: Tensor) -> None:
        expected = (len(observation), self.bins, *(side // self.stride for side in observation.shape[2:]))
        if tuple(scores.shape) != expected:
            raise InputError(
                f"scores are (B, bins, H / stride, W / stride), {expected} by the stride {self.stride}, but "
                f"{type(self).__name__} makes {tuple(scores.shape)}; give it a channel a bin and the stride that it has"
            )


class LegPolicy(GraspPolicy):
    """phi(o, l) correlated with kappa(l), read out from even irreps to bins (LEG, Eq. 1 and 2).

    What turns how is declared by the modules' `in_type` and `out_type`, so that a law needs no arguments.

    Args:
        phi: `(B, 4, H, W)`, `(B, D)` -> features `(B, C, H / stride, W / stride)`; has `stride`.
        kappa: `(B, D)` -> kernels `(B, out_type.size, C, k, k)`; has `in_type` and `out_type`, and `even` if its
            kernels are all even (`equigrasp.correlation`).
        text_encoder: a name from `language.ENCODERS`.
        precision: of phi and of kappa's layers; correlation and read-out are always float32.
        bins: angles at which the field is read; more than its highest frequency.

    Attributes:
        correlation: what correlates features with kernels; None for the shortest exact route for kappa's kernels.

    Raises:
        InputError: if so few bins cannot carry the field's frequencies; asked to act, if phi's weights and kappa's are
            of two dtypes.
    """

    def __init__(
        self,
        phi: nn.Module,
        kappa: nn.Module,
        text_encoder: str = "minilm",
        precision: str = "auto",
        bins: int = WORKSPACE.bins,
    ) -> None:
        super().__init__(int(phi.stride), text_encoder, precision, bins)  # ty: ignore[invalid-argument-type]
        self.phi = phi
        self.kappa = kappa
        self.correlation: Correlation | None = None
        self.out_type: fields.FieldType = kappa.out_type  # ty: ignore[invalid-assignment]
        self.synthesis = Constant(fields.synthesis(self.out_type.size - 1, bins))

    def _heard(self, instructions: tuple[str, ...], keep: bool) -> Tensor:
        check_dtypes(self.phi, self.kappa)
        return super()._heard(instructions, keep)

    def score(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """The field's values at the angles of the bins."""
        field = self.field(observation, embedding)
        with torch.autocast(observation.device.type, enabled=False):
            return torch.einsum("io,bohw->bihw", self.synthesis.value.to(field.dtype), field)

    @property
    def correlate(self) -> Correlation:
        """Features `(B, C, h, w)` and kernels `(B, out_type.size, C, k, k)` -> the field, as kappa's kernels allow."""
        return self.correlation or correlation_of(self.kappa)

    def at(self, bins: int) -> LegPolicy:
        """The same phi and kappa, weights shared, read at so many angles: a field over angles has a value at each.

        For finer angles than those trained on, at no training. Files do not keep it: it has no `config`.

        Raises:
            InputError: if so few bins cannot carry the field's frequencies.
        """
        weight = self.synthesis.value
        finer = LegPolicy(self.phi, self.kappa, self.text_encoder, self.precision, bins)
        finer.synthesis.to(weight.device, weight.dtype)
        finer.correlation = self.correlation
        # not by `train`, which would set phi's and kappa's, too
        finer.training = finer.synthesis.training = self.training
        return finer

    @property
    def reach(self) -> float | None:
        """How far a score sees from its cell's centre along each axis, in pixels; None where phi's view has no end."""
        seen, size = getattr(self.phi, "reach", None), getattr(self.kappa, "size", None)
        return None if seen is None or size is None else seen + size // 2 * self.stride

    def field(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """The score in even irreps, of type `out_type`: `(B, out_type.size, H / stride, W / stride)` float32.

        Raises:
            InputError: if phi's features and kappa's kernels do not fit each other, or their number is not B.
        """
        features, kernel = self.phi(observation, embedding), self._kept.kernel(embedding, self.kappa)
        check_fit(features, kernel, len(observation), self.out_type.size)
        with torch.autocast(observation.device.type, enabled=False):
            exact = torch.promote_types(observation.dtype, torch.float32)
            return self.correlate(features.to(exact), kernel.to(exact))


class DensePolicy(GraspPolicy):
    """A network whose 36 output channels are the bins: no symmetry but what the network has or learns.

    Args:
        network: `(B, 4, H, W)`, `(B, D)` -> scores `(B, 36, H / stride, W / stride)`; has `stride`.
        text_encoder: a name from `language.ENCODERS`.
        precision: of the network.
    """

    def __init__(self, network: nn.Module, text_encoder: str = "minilm", precision: str = "auto") -> None:
        super().__init__(int(network.stride), text_encoder, precision)  # ty: ignore[invalid-argument-type]
        self.network = network

    def score(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """What the network puts out."""
        return self.network(observation, embedding)


@contextlib.contextmanager
def evaluating(module: nn.Module) -> Generator[None]:
    """All of it in evaluation mode; then each part as it was before, what was frozen by `eval` among them."""
    modes = [(each, each.training) for each in module.modules()]
    module.eval()
    try:
        yield
    finally:
        for each, training in modes:
            each.training = training


def to_tensor(observation: Observation) -> Tensor:
    """An observation as the policy takes it: `(4, H, W)` float32, colour 0 .. 255 and height in metres."""
    channels = np.empty((4, *observation.shape), dtype=np.float32)
    # channel by channel: put together by pixels and then turned over it takes seven times as long
    channels[:3] = observation.color.transpose(2, 0, 1)
    channels[3] = observation.height
    return torch.from_numpy(channels)

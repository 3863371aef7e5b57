"""A LegPolicy of parts of one's own: their dtypes, their modes, and what it shares with its like at other angles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from equigrasp import Grasp, Observation, models
from equigrasp.config import OwnConfig
from equigrasp.encoder import UNet
from equigrasp.errors import InputError
from equigrasp.kernel import SteerableKernel
from equigrasp.naming import attribute
from equigrasp.policy import LegPolicy
from equigrasp.reference_head import correlate_directly

DOCS = Path(__file__).parent.parent / "docs"


def scene() -> Observation:
    return Observation(np.full((32, 64, 3), 90, dtype=np.uint8), np.zeros((32, 64), dtype=np.float32))


@pytest.fixture
def ring_kernel(monkeypatch: pytest.MonkeyPatch) -> nn.Module:
    """The README's own kernel, docs/my_kernel.py, as wide as a text encoder's embeddings."""
    monkeypatch.syspath_prepend(DOCS)
    kind = attribute("my_kernel:RingKernel", "a kernel", "RingKernel")
    monkeypatch.setattr(kind, "embedding_size", 512)
    return kind()


def test_the_kernel_of_the_readme_acts_once_it_has_phis_dtype(ring_kernel: nn.Module) -> None:
    with pytest.raises(InputError, match=r"phi's .* torch.float32 and kappa's are torch.float64.*kappa.float\(\)"):
        LegPolicy(UNet(512, 3), ring_kernel, "hashing", "float32").act(scene(), "the mug")
    assert isinstance(LegPolicy(UNet(512, 3), ring_kernel, "hashing").double().act(scene(), "the mug"), Grasp)
    policy = LegPolicy(UNet(512, 3), ring_kernel.float(), "hashing", "float32").eval()
    assert isinstance(policy.act(scene(), "the mug"), Grasp)
    assert isinstance(policy.double().act(scene(), "the mug"), Grasp)


def test_a_part_without_weights_goes_with_any_dtype() -> None:
    class Means(nn.Module):
        stride = 2

        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            return nn.functional.avg_pool2d(observation, 2)

    kernel = SteerableKernel(512, 4, 17, 4)
    for kappa in (kernel, kernel.double()):
        LegPolicy(Means(), kappa, "hashing", "float32").act(scene(), "the mug")
    with pytest.raises(InputError, match=r"torch.float32 and kappa's are torch.float64"):
        LegPolicy(UNet(512, 4), kernel, "hashing", "float32").act(scene(), "the mug")


@dataclass(frozen=True, kw_only=True)
class TwoDtypes(OwnConfig):
    def build(self) -> LegPolicy:
        return LegPolicy(UNet(512, 4), SteerableKernel(512, 4, 17, 4).double(), self.encoder, self.precision)


def test_a_config_that_builds_parts_of_two_dtypes_is_refused_before_a_training() -> None:
    with pytest.raises(InputError, match=r"torch.float32 and kappa's are torch.float64"):
        models.build(TwoDtypes(name="two", summary="", text_encoder="hashing", precision="float32"))


@pytest.mark.parametrize("frozen", ["phi", "kappa", "phi.stem"])
@pytest.mark.parametrize("training", [True, False])
def test_reading_at_other_angles_leaves_every_mode_as_it_is(frozen: str, training: bool) -> None:
    policy = models.build(replace(models.MODELS["leg-steerable"], text_encoder="hashing", precision="float32"))
    assert isinstance(policy, LegPolicy)
    policy.train(training)
    part = next(policy.phi.children()) if frozen == "phi.stem" else policy.get_submodule(frozen)
    part.train(not training)
    before = [each.training for each in policy.modules()]
    finer = policy.at(72)
    assert [each.training for each in policy.modules()] == before
    assert finer.training == finer.synthesis.training == policy.training


def test_at_other_angles_features_are_correlated_in_the_policys_own_way() -> None:
    policy = models.build(replace(models.MODELS["leg-steerable"], text_encoder="hashing", precision="float32"))
    assert isinstance(policy, LegPolicy)
    assert policy.at(72).correlation is None
    policy.correlation = correlate_directly
    assert policy.at(72).correlate is correlate_directly
    with torch.no_grad():
        observation, embedding = torch.rand(1, 4, 32, 64), torch.randn(1, 512)
        assert torch.equal(policy.at(36).eval()(observation, embedding), policy.eval()(observation, embedding))

"""The policy: the grasp moves with the scene, labels and grasps are one map, a batch is its members."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from equigrasp import WORKSPACE, Grasp, Motion, Observation, fields, models
from equigrasp.errors import InputError
from equigrasp.kernel import PlainKernel, SteerableKernel
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy, to_tensor
from equigrasp.read_out import ReadOut


class Pooled(nn.Module):
    """A phi that hardly does anything, and so turns with the scene: the mean of each cell, channels repeated."""

    stride = 2

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return torch.nn.functional.avg_pool2d(observation, 2).repeat(1, 2, 1, 1)


class Mirrored(nn.Module):
    """A kernel upside down: it turns clockwise where it should turn counter-clockwise."""

    def __init__(self, kernel: nn.Module) -> None:
        super().__init__()
        self.kernel = kernel
        self.out_type = kernel.out_type

    def forward(self, embedding: Tensor) -> Tensor:
        return self.kernel(embedding).flip(3)


def leg(config: models.ModelConfig | str, seed: int = 0) -> LegPolicy:
    policy = models.build(config, seed)
    assert isinstance(policy, LegPolicy)
    return policy


def pooled(name: str, wrap: Callable[[nn.Module], nn.Module] = lambda kernel: kernel) -> LegPolicy:
    return LegPolicy(Pooled(), wrap(leg(name, seed=1).kappa), precision="float32").eval()


def embeddings(count: int = 1, size: int = 384) -> Tensor:
    rows = torch.randn(count, size, generator=torch.Generator().manual_seed(0))
    return torch.nn.functional.normalize(rows)


def blobs(motion: Motion, seed: int = 1) -> Tensor:
    """Six Gaussians, moved by g and evaluated at every pixel: `(1, 4, 160, 320)`."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:160, :320]
    points = motion.inverse()(WORKSPACE.to_world(np.stack([columns, rows], axis=-1)))
    image = np.zeros((4, 160, 320))
    for _ in range(6):
        centre, weight = 0.02 * rng.normal(size=2), rng.normal(size=(4, 1, 1))
        image += weight * np.exp(-((points - centre) ** 2).sum(axis=-1) / (2 * 0.012**2))
    return torch.from_numpy(image).float()[None]


@torch.no_grad()
def best(policy: GraspPolicy, observation: Tensor) -> Grasp:
    scores = policy.logits(observation, embeddings())[0].numpy()
    return policy.read_out((160, 320)).best(scores)


def apart(a: Grasp, b: Grasp) -> tuple[float, float]:
    """Pixels and degrees between two grasps."""
    turn = abs((a.theta - b.theta + math.pi / 2) % math.pi - math.pi / 2)
    return math.hypot(a.u - b.u, a.v - b.v), math.degrees(turn)


def observation(seed: int = 0, shape: tuple[int, int] = (64, 96)) -> Observation:
    rng = np.random.default_rng(seed)
    color = rng.integers(0, 256, (*shape, 3), dtype=np.uint8)
    return Observation(color, rng.uniform(0, 0.1, shape).astype(np.float32))


def batch(count: int) -> Tensor:
    return torch.stack([to_tensor(observation(seed)) for seed in range(count)])


# Eq. 2: the best grasp moves with the scene


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable", "leg-equivariant", "leg-unet-no-kernel-language"])
@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_quarter_turn_of_the_scene_turns_the_grasp(name: str, degrees: int) -> None:
    policy, g = pooled(name), Motion(math.radians(degrees))
    distance, angle = apart(best(policy, blobs(g)), WORKSPACE.move_grasp(g, best(policy, blobs(Motion()))))
    assert distance < 0.01
    assert angle < 0.05


@pytest.mark.parametrize(("degrees", "x", "y"), [(5, 0, 0), (25, 0.1, 0.02), (70, -0.2, 0.01), (130, 0.05, -0.03)])
def test_any_motion_of_the_scene_moves_the_exact_models_grasp(degrees: float, x: float, y: float) -> None:
    policy, g = pooled("leg-steerable"), Motion(math.radians(degrees), x, y)
    distance, angle = apart(best(policy, blobs(g)), WORKSPACE.move_grasp(g, best(policy, blobs(Motion()))))
    assert distance < 1.5
    assert angle < 2.5


def test_without_steerability_the_grasp_does_not_turn() -> None:
    policy, g = pooled("leg-unet-no-steerability"), Motion(math.radians(90))
    distance, angle = apart(best(policy, blobs(g)), WORKSPACE.move_grasp(g, best(policy, blobs(Motion()))))
    assert distance > 4 or angle > 10


def quarter_turn_error(policy: LegPolicy, quarters: int, bins: int) -> float:
    """How far the scores of a turned scene are from the turned scores, relative, through the whole policy."""
    scene, words = batch(1).to(policy.synthesis.value.dtype), embeddings().to(policy.synthesis.value.dtype)
    with torch.no_grad():
        scores, turned = policy(scene, words), policy(scene.rot90(quarters, (2, 3)), words)
    expected = scores.rot90(quarters, (2, 3)).roll(bins * quarters, dims=1)
    return float((turned - expected).abs().max() / scores.abs().max())


def test_a_quarter_turn_goes_through_the_whole_equivariant_policy() -> None:
    row = models.MODELS["leg-equivariant"]
    policy = leg(replace(row, precision="float32"), seed=0)
    assert quarter_turn_error(policy, 1, 18) < 1e-4
    policy.double()
    assert max(quarter_turn_error(policy, quarters, 18) for quarters in (1, 2, 3)) < 1e-12
    assert quarter_turn_error(policy, 1, 17) > 0.1, "the angle turns with the scene"
    for broken in ({"phi": "unet"}, {"kernel": "plain"}):
        policy = leg(replace(row, precision="float32", **broken), seed=0).double()
        assert quarter_turn_error(policy, 1, 18) > 0.05, broken


def test_a_policy_can_be_read_at_other_angles_than_it_was_trained_on(tmp_path: Path) -> None:
    row = replace(models.MODELS["leg-equivariant"], precision="float32")
    policy = leg(row, seed=0).double()
    scene, words = batch(1).double(), embeddings().double()
    frequency = policy.out_type.size - 1
    for bins in (35, 72, 100):
        other = policy.at(bins)
        with torch.no_grad():
            scores, field = other(scene, words), policy.field(scene, words)
        assert scores.shape[1] == other.read_out((64, 96)).bins == bins
        assert other.kappa is policy.kappa
        for index in (0, 1, bins - 1):
            turned = fields.rotation(frequency, -index * math.pi / bins)
            expected = torch.einsum("o,bohw->bhw", fields.synthesis(frequency)[0] @ turned, field)
            torch.testing.assert_close(scores[:, index], expected, rtol=0, atol=1e-10)
    assert quarter_turn_error(policy.at(72), 1, 36) < 1e-12
    assert quarter_turn_error(policy.at(72), 1, 18) > 0.1, "a quarter turn is half of the bins, however many"
    with pytest.raises(InputError, match="16 bins over pi carry even frequencies below 16, but this is 16"):
        policy.at(16)
    with pytest.raises(InputError, match="put together by hand"):
        policy.at(72).save_pretrained(tmp_path / "finer")


def test_a_mirrored_kernel_turns_the_wrong_way() -> None:
    policy, g = pooled("leg-steerable", Mirrored), Motion(math.radians(25))
    expected = WORKSPACE.move_grasp(g, best(policy, blobs(Motion())))
    distance, angle = apart(best(policy, blobs(g)), expected)
    assert distance > 4 or angle > 10


# The policy


def test_probabilities_sum_to_one() -> None:
    policy = leg("leg-steerable", seed=0)
    with torch.no_grad():
        total = policy.log_probabilities(batch(2), embeddings(2)).exp().flatten(1).sum(dim=1)
    torch.testing.assert_close(total, torch.ones(2))


def test_the_first_scores_are_small_and_not_flat() -> None:
    for name, row in models.MODELS.items():
        if row.encoder != "minilm":
            continue  # test_clip_models.py has those on CLIP
        with torch.no_grad():
            scores = models.build(name, seed=0)(batch(1), embeddings())
        assert 1e-3 < scores.std() < 3, name


def test_acting_is_the_maximum_of_the_scores_of_the_moment() -> None:
    policy = leg(replace(models.MODELS["leg-steerable"], text_encoder="hashing"), seed=0)
    scene, words = observation(), "pick the mug by its handle"
    policy.train()
    for _ in range(2):
        with torch.no_grad():
            scores = policy(to_tensor(scene)[None], policy.embed(words)[None])[0].numpy()
        assert policy.act(scene, words) == policy.read_out(scene.shape).best(scores)
        # a kernel kept from before this step would be stale
        with torch.no_grad():
            for parameter in policy.kappa.parameters():
                parameter.data.mul_(-1.5)
    assert policy.training


def test_full_resolution_is_a_setting() -> None:
    policy = leg(replace(models.MODELS["leg-steerable"], stride=1), seed=0)
    with torch.no_grad():
        assert policy(batch(1), embeddings()).shape == (1, 36, 64, 96)
    assert policy.read_out((64, 96)) == ReadOut(64, 96, 1)


def test_bfloat16_gives_float32_scores_that_agree_roughly() -> None:
    exact, rough = (
        models.build(replace(models.MODELS["leg-steerable"], precision=precision), seed=0)
        for precision in ("float32", "bfloat16")
    )
    with torch.no_grad():
        a, b = exact(batch(1), embeddings()), rough(batch(1), embeddings())
    assert b.dtype == torch.float32
    assert 0 < (a - b).abs().max() < 0.2 * a.abs().max()


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable"])
def test_a_batch_is_trained_on_as_its_members(name: str) -> None:
    """The loss of a batch is the mean of its members', and so are its gradients."""
    policy = leg(replace(models.MODELS[name], precision="float32"), seed=0).double()
    scenes, words, labels = batch(3).double(), embeddings(3).double(), torch.tensor([5, 3000, 50000])

    def gradients(chosen: slice) -> list[Tensor]:
        loss = torch.nn.functional.cross_entropy(policy(scenes[chosen], words[chosen]).flatten(1), labels[chosen])
        return list(torch.autograd.grad(loss, list(policy.parameters())))

    members = [gradients(slice(each, each + 1)) for each in range(3)]
    for together, *alone in zip(gradients(slice(None)), *members, strict=True):
        expected = torch.stack(alone).mean(dim=0)
        torch.testing.assert_close(together, expected, rtol=0, atol=1e-9 * float(expected.abs().max()) + 1e-15)


def test_an_observation_becomes_colour_and_metres() -> None:
    scene = observation()
    tensor = to_tensor(scene)
    assert tensor.shape == (4, 64, 96)
    assert tensor.dtype == torch.float32
    np.testing.assert_array_equal(tensor[:3].numpy().transpose(1, 2, 0), scene.color)
    np.testing.assert_array_equal(tensor[3].numpy(), scene.height)


def test_types_are_declared() -> None:
    policy = leg("leg-steerable", seed=0)
    assert policy.out_type == fields.even_type(16)
    assert policy.phi.out_type == policy.kappa.in_type == fields.trivial_type(8)


def test_inputs_that_cannot_be_are_refused() -> None:
    policy = leg(replace(models.MODELS["leg-steerable"], text_encoder="hashing"), seed=0)
    words = embeddings(2, 512)
    with pytest.raises(ValueError, match=r"multiples of 32, but this is 60 x 96"):
        policy(torch.zeros(2, 4, 60, 96), words)
    with pytest.raises(ValueError, match=r"\(B, 4, H, W\), colour and height"):
        policy(torch.zeros(2, 3, 64, 96), words)
    with pytest.raises(ValueError, match=r"one embedding goes with each"):
        policy(torch.zeros(1, 4, 64, 96), words)
    with pytest.raises(ValueError, match=r"embeddings of 'hashing' are \(B, 512\), but this is \(2, 384\)"):
        policy(torch.zeros(2, 4, 64, 96), embeddings(2))
    with pytest.raises(ValueError, match="says what to grasp"):
        policy.act(observation(), " ")
    seen = observation()
    # as `reset` and `step` give it
    wrong: Any = {"color": seen.color, "height": seen.height, "instruction": "pick up the mug"}
    with pytest.raises(InputError, match=r"but this is a dict; of an environment pass env\.unwrapped\.observation"):
        policy.act(wrong, "pick up the mug")


class Scores(nn.Module):
    """A network of a user's own, with so many channels, which may say another stride than it has."""

    def __init__(self, channels: int, stride: int = 2) -> None:
        super().__init__()
        self.stride = stride
        self.see = nn.Conv2d(4, channels, 2, stride=2)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return self.see(observation)


@pytest.mark.parametrize(("channels", "stride"), [(35, 2), (40, 2), (18, 2), (36, 1), (36, 4)])
def test_scores_of_another_shape_are_refused(channels: int, stride: int) -> None:
    cells = 64 // stride, 96 // stride
    sentence = rf"\(1, 36, {cells[0]}, {cells[1]}\) by the stride {stride}, .* makes \(1, {channels}, 32, 48\)"
    with pytest.raises(InputError, match=sentence):
        DensePolicy(Scores(channels, stride), "hashing").act(observation(), "the mug")
    assert DensePolicy(Scores(36), "hashing").act(observation(), "the mug")


@pytest.mark.parametrize(("kernel", "channels"), [(8, 4), (1, 8), (8, 1)])
@pytest.mark.parametrize("kind", [SteerableKernel, PlainKernel])
def test_a_kernel_of_other_channels_than_phi_is_refused(kind: type, kernel: int, channels: int) -> None:
    policy = LegPolicy(Scores(channels), kind(512, kernel, 17, maximum_frequency=4), "hashing")
    sentence = rf"are \(1, 5, {channels}, k, k\), k odd, .* but these are \(1, 5, {kernel}, 17, 17\)"
    with pytest.raises(InputError, match=sentence):
        policy(batch(1), embeddings(1, 512))


class Fixed(nn.Module):
    """A kernel of a user's own that is the same for all, of one shape."""

    in_type, out_type = fields.trivial_type(2), fields.even_type(2)

    def __init__(self, even: bool, *shape: int) -> None:
        super().__init__()
        taps = torch.randn(*shape, generator=torch.Generator().manual_seed(0))
        self.even, self.taps = even, nn.Parameter(taps + taps.flip((3, 4)))

    def forward(self, embedding: Tensor) -> Tensor:
        return self.taps


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("shape", [(1, 3, 2, 9, 9), (3, 3, 2, 8, 8), (3, 5, 2, 9, 9), (3, 3, 2, 9, 7)])
def test_a_kernel_of_another_shape_is_refused(shape: tuple[int, ...], even: bool) -> None:
    with pytest.raises(InputError, match=r"kernels are \(3, 3, 2, k, k\)"):
        LegPolicy(Scores(2), Fixed(even, *shape), "hashing")(batch(3), embeddings(3, 512))
    fitting = LegPolicy(Scores(2), Fixed(even, 3, 3, 2, 9, 9), "hashing")
    fitting(batch(3), embeddings(3, 512)).sum().backward()


def test_features_of_one_scene_are_not_taken_for_those_of_all() -> None:
    class First(Scores):
        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            return self.see(observation[:1])

    with pytest.raises(InputError, match=r"B = 3 here, but these are \(1, 2, 32, 48\)"):
        LegPolicy(First(2), Fixed(False, 3, 3, 2, 9, 9), "hashing")(batch(3), embeddings(3, 512))


def test_a_kernel_that_is_put_in_place_of_another_is_correlated_as_its_own() -> None:
    policy = leg(replace(models.MODELS["leg-steerable"], text_encoder="hashing", precision="float32"))
    policy.kappa = PlainKernel(512, 8, 17, 16)
    anew = LegPolicy(policy.phi, policy.kappa, "hashing", "float32")
    with torch.no_grad():
        assert torch.equal(policy(batch(1), embeddings(1, 512)), anew(batch(1), embeddings(1, 512)))

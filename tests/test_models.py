"""The rows of MODELS: what each builds, what may be combined, what a config means."""

import json
import pickle
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load, save
from torch import Tensor

from equigrasp import models
from equigrasp.composition import KERNELS, PHIS
from equigrasp.config import ClipConfig, OwnConfig, read_out_at
from equigrasp.errors import InputError

OWN = [name for name, row in models.MODELS.items() if not isinstance(row, ClipConfig)]
"""Those on CLIP are tested on small towers, in test_clip_models.py."""


def embeddings(count: int = 1) -> Tensor:
    rows = torch.randn(count, 384, generator=torch.Generator().manual_seed(0))
    return torch.nn.functional.normalize(rows)


def batch(count: int) -> Tensor:
    """Noise of the size of colours and heights, `(count, 4, 64, 96)`."""
    noise = torch.rand(count, 4, 64, 96, generator=torch.Generator().manual_seed(1))
    return noise * torch.tensor([255, 255, 255, 0.1]).view(4, 1, 1)


@pytest.mark.parametrize("name", OWN)
def test_a_batch_is_its_members(name: str) -> None:
    policy = models.build(replace(models.MODELS[name], precision="float32"), seed=0)
    observations, language = batch(3), embeddings(3)
    with torch.no_grad():
        together = policy(observations, language)
        singles = [policy(o[None], e[None]) for o, e in zip(observations, language, strict=True)]
    assert together.shape == (3, 36, 32, 48)
    assert together.dtype == torch.float32
    torch.testing.assert_close(together, torch.cat(singles), rtol=1e-4, atol=1e-5)
    assert (together[0] - together[1]).abs().max() > 0.01


@pytest.mark.parametrize("name", OWN)
def test_every_parameter_learns(name: str) -> None:
    policy = models.build(name, seed=0)
    policy.log_probabilities(batch(1), embeddings())[0, 3, 5, 7].backward()
    silent = [n for n, p in policy.named_parameters() if p.grad is None or not p.grad.any()]
    assert not silent


@pytest.mark.parametrize("name", OWN)
def test_a_seed_gives_the_same_bits_and_leaves_torchs_own_alone(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = torch.random.get_rng_state()
    # of GPUs, where there are some; torch keeps for later what it is told without any
    monkeypatch.setattr(torch.cuda, "manual_seed_all", lambda seed: pytest.fail("the GPUs' generators were seeded"))
    first, again, other = (models.build(name, seed).state_dict() for seed in (3, 3, 4))
    with torch.device("meta"):
        elsewhere = models.build(name, 3).state_dict()
    assert all(torch.equal(first[key], elsewhere[key]) for key in first)
    assert torch.equal(before, torch.random.get_rng_state())
    assert all(torch.equal(first[key], again[key]) for key in first)
    assert any(not torch.equal(first[key], other[key]) for key in first)


def test_policies_go_to_another_process_as_they_are(tmp_path: Path) -> None:
    sent = tmp_path / "policies"
    observation, language = batch(1), embeddings()
    policies = [models.build(replace(models.MODELS[name], precision="float32"), seed=5).eval() for name in OWN]
    with torch.no_grad():
        expected = [policy(observation, language) for policy in policies]
    sent.write_bytes(pickle.dumps((policies, expected, observation, language)))
    there = f"""
import pickle, torch
torch.set_num_threads({torch.get_num_threads()})
policies, expected, observation, language = pickle.loads(open({str(sent)!r}, "rb").read())
with torch.no_grad():
    same = [torch.equal(policy(observation, language), scores) for policy, scores in zip(policies, expected)]
print(*(policy.config.name for policy, each in zip(policies, same) if each))
"""
    done = subprocess.run([sys.executable, "-c", there], capture_output=True, text=True, check=True)
    assert done.stdout.split() == OWN


@pytest.mark.parametrize("name", [name for name, row in models.MODELS.items() if row.paper_parameters])
def test_a_row_has_the_papers_number_of_trainable_parameters_or_says_why_not(name: str) -> None:
    row = models.MODELS[name]
    trainable, _ = models.count_parameters(row)
    assert row.paper_parameters is not None
    assert abs(trainable / 1e6 - row.paper_parameters) < 0.1 * row.paper_parameters or row.note


def test_a_count_is_of_the_policy_that_is_built() -> None:
    row = models.MODELS["fcgq"]
    assert models.count_parameters(row) == (sum(each.numel() for each in models.build(row).parameters()), 0)


def test_a_count_needs_no_memory_for_what_it_counts() -> None:
    trainable, _ = models.count_parameters(replace(models.MODELS["fcgq"], widths=(48, 96, 192, 384, 4_000_000)))
    assert trainable > 10**14


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("phi", [name for name in PHIS if name != "two-stream"])
@pytest.mark.parametrize("told", [True, False])
def test_every_kernel_goes_with_every_phi(kernel: str, phi: str, told: bool) -> None:
    row = replace(
        models.MODELS["leg-steerable"], kernel=kernel, phi=phi, widths=(8,) * 5, kernel_language=told, phi_language=told
    )
    policy = models.build(row, seed=0)
    with torch.no_grad():
        scores = policy(batch(1).expand(2, -1, -1, -1), embeddings(2))
    assert scores.shape == (2, 36, 32, 48)
    assert torch.equal(scores[0], scores[1]) is not told, "only what is told the instruction tells two apart"


def test_an_ablation_differs_from_the_full_model_by_what_it_is_named_for() -> None:
    full = models.MODELS["leg-unet"].to_dict()
    differs = {
        "no-kernel-language": {"kernel_language": False},
        "no-steerability": {"kernel": "plain"},
        "no-phi-language": {"phi_language": False},
    }
    for name, changes in differs.items():
        row = models.MODELS[f"leg-unet-{name}"].to_dict()
        labels = {key: row[key] for key in ("name", "summary", "paper_parameters")}
        assert row == full | labels | changes


def test_a_config_from_before_phi_could_be_chosen_means_what_it_meant() -> None:
    for name in ("leg-unet", "leg-steerable"):
        later = {"rings", "kernel_language", "phi", "phi_group_order", "phi_language"}
        old = {key: value for key, value in models.MODELS[name].to_dict().items() if key not in later}
        assert models.ModelConfig.from_dict(old) == models.MODELS[name]


@pytest.mark.parametrize("name", ["leg-equivariant", "leg-unet-no-phi-language", "leg-unet-no-kernel-language"])
def test_weights_saved_in_training_act_the_same_when_loaded(name: str) -> None:
    row = replace(models.MODELS[name], precision="float32")
    trained, loaded = models.build(row, seed=1).train(), models.build(row, seed=2)
    with torch.no_grad():
        expected = trained(batch(1), embeddings())
        assert not torch.allclose(loaded(batch(1), embeddings()), expected, atol=1e-3)
        loaded.load_state_dict(
            load(save({name: value.contiguous() for name, value in trained.state_dict().items()})), strict=True
        )
        torch.testing.assert_close(loaded.eval()(batch(1), embeddings()), expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", models.MODELS)
def test_a_config_survives_json(name: str) -> None:
    config = models.MODELS[name]
    assert config.name == name
    assert models.ModelConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("fcgq", {"stride": 2.0}, r"stride is a whole number, but this one's is 2\.0"),
        ("fcgq", {"stride": True}, "stride is a whole number, but this one's is True"),
        ("fcgq", {"widths": None}, "widths is a list of whole numbers, but this one's is None"),
        ("fcgq", {"widths": "ab"}, "widths is a list of whole numbers, but this one's is 'ab'"),
        ("fcgq", {"widths": [8, 8, 8, 8, "8"]}, "widths is a list of whole numbers"),
        ("fcgq", {"text_encoder": None}, "text_encoder is a string, but this one's is None"),
        ("fcgq", {"text_encoder": 3}, "text_encoder is a string, but this one's is 3"),
        ("fcgq", {"precision": None}, "precision is a string, but this one's is None"),
        ("fcgq", {"precision": ["auto"]}, "precision is a string"),
        ("fcgq", {"name": None}, "name is a string"),
        ("leg-unet", {"phi_language": "no"}, "phi_language is true or false, but this one's is 'no'"),
        ("leg-unet", {"paper_parameters": "3.3"}, "paper_parameters is a number or null, but this one's is '3.3'"),
    ],
)
def test_a_setting_of_another_type_is_refused(name: str, change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=f"^a model's .*{sentence}.*; put the right one into its config.json"):
        models.ModelConfig.from_dict(models.MODELS[name].to_dict() | change)


@dataclass(frozen=True, kw_only=True)
class Loose(OwnConfig):
    scale: float = 1

    def build(self) -> Any:
        pytest.fail("it is read here, not built")


def test_what_a_family_of_ones_own_adds_is_its_own_affair() -> None:
    values = {"family": Loose.family, "name": "loose", "summary": "", "scale": "large"}
    assert vars(models.ModelConfig.from_dict(values))["scale"] == "large"
    with pytest.raises(InputError, match="a model's precision is a string, but this one's is None"):
        models.ModelConfig.from_dict(values | {"precision": None})


def test_models_are_built_in_torchs_default_dtype() -> None:
    """In a process of its own: escnn keeps what it has made once."""
    code = f"""
import torch
torch.set_default_dtype(torch.float64)
from equigrasp import models
for name in {OWN!r}:
    print(name, models.build(name)(torch.rand(1, 4, 64, 96), torch.rand(1, 384)).dtype, torch.get_default_dtype())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [f"{name} torch.float64 torch.float64" for name in OWN]


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable"])
def test_features_without_channels_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="a field has a channel or more, but this is 0"):
        models.build(replace(models.MODELS[name], channels=0))


def test_listing_models_costs_no_torch() -> None:
    code = "import sys, equigrasp.models; print('torch' in sys.modules, 'escnn' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["False", "False"]


def test_what_cannot_be_is_refused() -> None:
    row = models.MODELS["leg-unet"]
    with pytest.raises(ValueError, match="no model 'leg-unt'; did you mean 'leg-unet'"):
        models.build("leg-unt")
    with pytest.raises(ValueError, match="'kernel_sise'; did you mean 'kernel_size'"):
        models.ModelConfig.from_dict(row.to_dict() | {"kernel_sise": 3})
    with pytest.raises(ValueError, match="incomplete"):
        models.ModelConfig.from_dict({"name": "mine"})
    with pytest.raises(ValueError, match="no kernel 'lifed'; did you mean 'lifted'"):
        models.build(replace(row, kernel="lifed"))
    with pytest.raises(ValueError, match="no phi 'steerable-net'; did you mean 'steerable-unet'"):
        models.build(replace(row, phi="steerable-net"))
    with pytest.raises(ValueError, match="C_6 does not contain a turn by 90 degrees"):
        models.build(replace(row, phi="steerable-unet", phi_group_order=6))
    with pytest.raises(ValueError, match="precision"):
        models.build(replace(row, precision="float16"))
    with pytest.raises(ValueError, match="stride 1 or 2"):
        models.build(replace(row, stride=4))
    with pytest.raises(ValueError, match="five widths"):
        models.build(replace(row, widths=(8, 16)))
    with pytest.raises(ValueError, match="no text encoder 'minilmm'"):
        models.build(replace(row, text_encoder="minilmm"))


def test_a_read_out_has_the_resolution_that_is_asked_for() -> None:
    for name in ("leg-unet", "leg-steerable", "leg-equivariant", "fcgq"):
        row = models.MODELS[name]
        assert read_out_at(row, "half") == replace(row, stride=2)
        assert models.build(read_out_at(row, "full"), seed=0).stride == 1
    with pytest.raises(InputError, match="did you mean 'full'"):
        read_out_at(models.MODELS["leg-unet"], "ful")
    for name in ("vit", "leg-cliport", "cliport-rn50"):
        with pytest.raises(InputError, match="has its own resolution"):
            read_out_at(models.MODELS[name], "full")

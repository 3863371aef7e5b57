"""CLIP's towers and the models on them: weights arrive where they should, stay frozen, and are missed in one sentence.

The loading is put through its paces on small towers of CLIP's own layers, in files of the layouts that exist. The
real RN50 is as slow as it is large: `pytest -m slow`.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import open_clip
import pytest
import torch
from folders import contents
from safetensors.torch import load_file, save_file
from torch import Tensor

from equigrasp import clip, language, models
from equigrasp.cli import main
from equigrasp.config import ClipConfig, CliportConfig, LegClipConfig, ModelConfig, RotatorConfig
from equigrasp.encoder.clip_image import ClipImage
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.plan import PLAN, WEIGHTS, Training
from equigrasp.policy import GraspPolicy, to_tensor
from equigrasp.training import CHECKPOINT, load_policy, train
from equigrasp.workspace import WORKSPACE

TEXT = {"context_length": 77, "vocab_size": 49408, "width": 16, "heads": 2, "layers": 1}
VISION = {
    "tiny-rn": {"image_size": 64, "layers": [1, 1, 1, 1], "width": 8, "head_width": 64, "patch_size": None},
    "tiny-vit": {"image_size": 64, "layers": 4, "width": 32, "head_width": 16, "patch_size": 32},
}
TOWERS = {
    "clip-tiny-rn": clip.Tower("tiny-rn", "nobody/nothing", 24, (4, 3, 3, 3), (16, 24)),
    "clip-tiny-vit": clip.Tower("tiny-vit", "nobody/nothing", 16, (32, 3, 32, 32), (16, 16)),
}
ON_CLIP = {
    "leg-cliport": LegClipConfig(
        name="leg-cliport",
        summary="",
        kernel="steerable",
        kernel_size=17,
        maximum_frequency=4,
        tower="clip-tiny-rn",
        semantic_widths=(16, 16, 8, 8),
        widths=(8, 8, 16, 16, 16),
        text_encoder="hashing",
        clip_weights="random",
    ),
    "cliport-rn50": CliportConfig(
        name="cliport-rn50",
        summary="",
        tower="clip-tiny-rn",
        semantic_widths=(16, 16, 8, 8),
        widths=(8, 8, 16, 16, 16),
        text_encoder="hashing",
        clip_weights="random",
    ),
}
ON_CLIP["cliport-vit"] = replace(ON_CLIP["cliport-rn50"], name="cliport-vit", tower="clip-tiny-vit")
ON_CLIP["cliport-rotator"] = RotatorConfig(
    **{key: value for key, value in vars(ON_CLIP["cliport-rn50"]).items() if key != "name"},
    name="cliport-rotator",
    chunk=12,
)
BRIEF = Training(steps=2, seed=0, threads=1)


@pytest.fixture(scope="module", autouse=True)
def tiny_architectures(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Two small architectures beside open_clip's own."""
    folder = tmp_path_factory.mktemp("architectures")
    for tower in TOWERS.values():
        vision = VISION[tower.architecture]
        config = {"embed_dim": tower.size, "quick_gelu": True, "vision_cfg": vision, "text_cfg": TEXT}
        (folder / f"{tower.architecture}.json").write_text(json.dumps(config))
    open_clip.add_model_config(folder)


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Two small towers beside CLIP's own, an empty cache, and no network."""
    for name, tower in TOWERS.items():
        monkeypatch.setitem(clip.TOWERS, name, tower)
        monkeypatch.setitem(language.ENCODERS, name, tower.size)
    monkeypatch.setenv("EQUIGRASP_CACHE", str(tmp_path_factory.mktemp("embeddings")))
    monkeypatch.setattr(language, "_memory", {})
    monkeypatch.setattr("huggingface_hub.try_to_load_from_cache", lambda *_: None)
    monkeypatch.setattr(clip, "is_online", lambda: False)


def weights_of(name: str, path: Path, layout: str = "open_clip", seed: int = 7) -> dict[str, Tensor]:
    """Write random weights as a file of that layout, and give the numbers that should be read from it."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = clip.load(name, "random")
        for tensor in model.state_dict().values():
            if tensor.is_floating_point():
                tensor.add_(0.02 * torch.randn_like(tensor)).abs_()
    tensors = {key: value.contiguous() for key, value in model.state_dict().items()}
    if layout == "openai":
        numbers = {"input_resolution": 64, "context_length": 77, "vocab_size": 49408}
        tensors = {key: value.half() if value.is_floating_point() else value for key, value in tensors.items()}
        save_file(tensors | {key: torch.tensor(value) for key, value in numbers.items()}, path)
    else:
        save_file(tensors, path)
    return {key: value.float() for key, value in tensors.items()}


def scene(rows: int = 64, columns: int = 64, count: int = 2) -> Tensor:
    noise = torch.rand(count, 4, rows, columns, generator=torch.Generator().manual_seed(0))
    return noise * torch.tensor([255, 255, 255, 0.1]).view(4, 1, 1)


def words(size: int = 512, count: int = 2) -> Tensor:
    return torch.nn.functional.normalize(torch.randn(count, size, generator=torch.Generator().manual_seed(1)))


# Weights from a file


@pytest.mark.parametrize("layout", ["open_clip", "openai"])
@pytest.mark.parametrize("name", TOWERS)
def test_every_number_of_a_file_arrives_in_its_place(name: str, layout: str, tmp_path: Path) -> None:
    expected = weights_of(name, tmp_path / "weights.safetensors", layout)
    loaded = clip.load(name, str(tmp_path / "weights.safetensors")).state_dict()
    assert loaded.keys() == expected.keys()
    for key, value in expected.items():
        assert loaded[key].dtype == torch.int64 or torch.equal(loaded[key], value), key
    image = dict(ClipImage(name, str(tmp_path / "weights.safetensors")).visual.state_dict())
    assert image
    for key, value in image.items():
        torch.testing.assert_close(value.float(), expected[f"visual.{key}"], rtol=0, atol=0)


@pytest.mark.parametrize("name", TOWERS)
def test_maps_are_open_clips_own(name: str, tmp_path: Path) -> None:
    """At the size that CLIP was trained on, open_clip's `forward_intermediates` is an independent reference."""
    path = tmp_path / "weights.safetensors"
    weights_of(name, path)
    image, mine = scene(), ClipImage(name, str(path))
    theirs = clip.load(name, str(path)).visual
    mean, deviation = (
        torch.tensor(each).view(3, 1, 1) for each in (open_clip.OPENAI_DATASET_MEAN, open_clip.OPENAI_DATASET_STD)
    )
    with torch.no_grad():
        maps = mine(image)
        reference = theirs.forward_intermediates((image[:, :3] / 255 - mean) / deviation)["image_intermediates"]
    assert len(maps) == 4
    for found, expected, channels in zip(maps, reference[::-1], mine.channels, strict=False):
        assert found.shape[1] == channels
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", TOWERS)
def test_maps_exist_at_any_size_of_heightmap(name: str) -> None:
    with torch.no_grad():
        maps = ClipImage(name, "random")(scene(160, 320, count=1))
    sizes = [(5 * 2**i, 10 * 2**i) for i in range(4)] if name.endswith("rn") else [(5, 10)] * 4
    assert [tuple(each.shape[2:]) for each in maps] == sizes


def test_the_text_is_read_by_the_same_weights(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    weights_of("clip-tiny-rn", path)
    config = replace(ON_CLIP["cliport-rn50"], clip_weights=str(path), text_encoder="clip")
    policy = models.build(config)
    assert policy.text_encoder == f"clip-tiny-rn:{path}"
    sentence = "pick up the mug by its handle"
    reference = clip.load("clip-tiny-rn", str(path)).encode_text(open_clip.get_tokenizer("RN50")([sentence]))[0]
    torch.testing.assert_close(policy.embed(sentence), reference.detach() / reference.norm(), rtol=1e-5, atol=1e-6)


def test_a_file_that_is_replaced_is_read_by_its_new_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "weights.safetensors"
    encoder = f"clip-tiny-rn:{path}"
    weights_of("clip-tiny-rn", path)
    old = language.embed(encoder, ["the mug"])
    weights_of("clip-tiny-rn", path, seed=8)
    new = language.embed(encoder, ["the mug"])
    assert not np.array_equal(new, old)
    # what a new process finds, in the cache on disk and without it
    for cache in (os.environ["EQUIGRASP_CACHE"], str(tmp_path / "empty")):
        monkeypatch.setenv("EQUIGRASP_CACHE", cache)
        monkeypatch.setattr(language, "_memory", {})
        language._encoder.cache_clear()
        np.testing.assert_array_equal(language.embed(encoder, ["the mug"]), new)


def test_a_relative_file_is_the_one_in_this_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for seed in (7, 8):
        folder = tmp_path / str(seed)
        folder.mkdir()
        weights_of("clip-tiny-rn", folder / "weights.safetensors", seed=seed)
        monkeypatch.chdir(folder)
        found.append(language.embed("clip-tiny-rn:weights.safetensors", ["the mug"]))
        whole = language.embed(f"clip-tiny-rn:{folder}/weights.safetensors", ["the mug"])
        np.testing.assert_array_equal(found[-1], whole)
    assert not np.array_equal(found[0], found[1])


def test_the_text_is_read_on_the_cpu_whatever_the_default_device(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    weights_of("clip-tiny-rn", path)
    reference = clip.load("clip-tiny-rn", str(path)).encode_text(open_clip.get_tokenizer("RN50")(["the mug"]))
    with torch.device("meta"):
        found = language.embed(f"clip-tiny-rn:{path}", ["the mug"])
    expected = torch.nn.functional.normalize(reference.detach())
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-5, atol=1e-6)


def test_weights_that_make_no_embedding_are_refused_and_nothing_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    weights_of("clip-tiny-rn", path)
    tensors = load_file(path)
    tensors["text_projection"][0] = torch.nan
    save_file(tensors, path)
    with pytest.raises(InputError, match=r"makes no unit vector of 'the mug'; its weights are damaged"):
        language.embed(f"clip-tiny-rn:{path}", ["the mug"])
    assert not contents(Path(os.environ["EQUIGRASP_CACHE"]))


def test_an_instruction_whose_end_clip_would_not_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    weights_of("clip-tiny-rn", path)
    language.embed(f"clip-tiny-rn:{path}", ["mug " * 75])
    with pytest.raises(InputError, match=r"clip-tiny-rn reads at most 77 tokens of an instruction, but this has 78"):
        language.embed(f"clip-tiny-rn:{path}", ["mug " * 76])


@pytest.mark.parametrize("name", sorted({"clip-rn50", "clip-rn101", "clip-vit-b-32", "clip-vit-b-16", "clip-vit-l-14"}))
def test_the_shapes_that_tell_towers_apart_are_open_clips(name: str) -> None:
    tower, config = clip.TOWERS[name], open_clip.get_model_config(clip.TOWERS[name].architecture)
    assert config is not None
    with torch.device("meta"):
        model = open_clip.CLIP(**config)
    state = model.state_dict()
    assert tuple(state["visual.conv1.weight"].shape) == tower.first
    assert tuple(state["text_projection"].shape) == tower.last
    assert config["embed_dim"] == tower.size == language.width(name)


# Models


@pytest.mark.parametrize("name", ON_CLIP)
def test_a_model_on_clip_scores_and_its_tower_stays_frozen(name: str) -> None:
    policy = models.build(replace(ON_CLIP[name], precision="float32")).train()
    before = {key: value.clone() for key, value in policy.state_dict().items()}
    scores = policy(scene(), words())
    assert scores.shape == (2, 36, 32, 32)
    assert scores.dtype == torch.float32
    scores[0, 3, 5, 7].backward()
    silent = [n for n, p in policy.named_parameters() if p.requires_grad and (p.grad is None or not p.grad.any())]
    assert not silent
    assert 1e-3 < scores.std() < 3
    torch.optim.Adam(policy.parameters()).step()
    after = policy.state_dict()
    frozen = {key for key in before if ".image." in key}
    assert frozen
    assert all(torch.equal(before[key], after[key]) for key in frozen), "weights and batch statistics alike"
    assert any(not torch.equal(before[key], after[key]) for key in before.keys() - frozen)


@pytest.mark.parametrize("name", ON_CLIP)
def test_instruction_scene_and_clip_all_matter(name: str) -> None:
    policy = models.build(replace(ON_CLIP[name], precision="float32"))
    with torch.no_grad():
        a, b = policy(scene(count=1).expand(2, -1, -1, -1), words())
        c, d = policy(scene(), words(count=1).expand(2, -1))
        for parameter in policy.parameters():
            parameter.mul_(1 if parameter.requires_grad else 1.5)
        changed = policy(scene(), words(count=1).expand(2, -1))[0]
    for one, other in ((a, b), (c, d), (c, changed)):
        assert (one - other).abs().max() > 1e-4 * one.abs().max()


@pytest.mark.parametrize("name", ["leg-cliport", "cliport-vit"])
def test_a_run_says_whose_clip_it_has_and_needs_the_file_no_more(
    name: str, tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    path, run = tmp_path / "weights.safetensors", tmp_path / "run"
    expected = weights_of(ON_CLIP[name].tower, path)
    config = replace(ON_CLIP[name], clip_weights=str(path))
    policy = train(config, BRIEF, demonstrations, data, run)
    assert json.loads((run / PLAN).read_text())["model"]["clip_weights"] == str(path)
    assert not [key for key in load_file(run / CHECKPOINT) if ".image." in key]
    path.unlink()
    loaded = load_policy(run)
    each = demonstrations[0]
    assert loaded.act(each.observation, each.instruction) == policy.act(each.observation, each.instruction)
    [key] = [key for key in loaded.state_dict() if key.endswith("image.visual.conv1.weight")]
    assert torch.equal(loaded.state_dict()[key], expected["visual.conv1.weight"])


@pytest.mark.parametrize("name", ["leg-cliport", "cliport-rn50"])
def test_a_saved_policy_brings_its_frozen_weights(name: str, tmp_path: Path) -> None:
    """Who loads it needs no CLIP, and has the very tower that it was trained on."""
    path = tmp_path / "weights.safetensors"
    weights_of(ON_CLIP[name].tower, path)
    policy = models.build(replace(ON_CLIP[name], clip_weights=str(path))).eval()
    policy.save_pretrained(tmp_path / "saved")
    assert "the weights of a local file, weights.safetensors, frozen" in (tmp_path / "saved" / "README.md").read_text()
    path.unlink()
    loaded = GraspPolicy.from_pretrained(tmp_path / "saved")
    with torch.no_grad():
        assert torch.equal(loaded.logits(scene(), words()), policy.logits(scene(), words()))


def test_a_training_does_not_go_on_with_other_frozen_weights(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    path, run = tmp_path / "weights.safetensors", tmp_path / "run"
    weights_of("clip-tiny-rn", path)
    config = replace(ON_CLIP["cliport-rn50"], clip_weights=str(path))
    train(config, BRIEF, demonstrations, data, run)
    (run / WEIGHTS).unlink()
    train(config, BRIEF, demonstrations, data, run)
    (run / WEIGHTS).unlink()
    weights_of("clip-tiny-rn", path, seed=8)
    with pytest.raises(InputError, match="other frozen weights"):
        train(config, BRIEF, demonstrations, data, run)


@pytest.mark.parametrize("name", [name for name, row in models.MODELS.items() if isinstance(row, ClipConfig)])
def test_a_row_on_clip_never_trains_on_random_numbers_by_itself(name: str) -> None:
    row = models.MODELS[name]
    assert isinstance(row, ClipConfig)
    assert row.clip_weights == "openai"
    assert row.encoder == row.tower
    assert row.untrained().encoder == row.tower
    with pytest.raises(InputError, match="--clip-weights random"):
        models.build(name)


# What cannot be


def damaged(kind: str, folder: Path) -> str:
    path = folder / "weights.safetensors"
    if kind == "nowhere":
        return str(path)
    if kind == "pickle":
        torch.save({"visual.conv1.weight": torch.zeros(3)}, folder / "RN50.pt")
        return str(folder / "RN50.pt")
    if kind == "text":
        path.write_text("a diary")
        return str(path)
    tensors = weights_of("clip-tiny-vit" if kind == "other tower" else "clip-tiny-rn", path)
    if kind == "truncated":
        path.write_bytes(path.read_bytes()[:-1000])
    if kind == "stranger":
        save_file({"weight": torch.zeros(3)}, path)
    if kind == "incomplete":
        save_file({key: value for key, value in tensors.items() if "layer3" not in key}, path)
    return str(path)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("nowhere", "is not one on this machine"),
        ("pickle", r"can run code when they are read; if you trust it, convert it once: .*RN50\.pt RN50\.safetensors"),
        ("text", "is damaged, or no .safetensors file at all"),
        ("truncated", "is damaged, or no .safetensors file at all"),
        ("other tower", "does not hold the weights of clip-tiny-rn, but those of clip-tiny-vit"),
        ("stranger", "does not hold the weights of clip-tiny-rn; name a file that does"),
        ("incomplete", "does not hold the weights of clip-tiny-rn: Missing key.*layer3"),
    ],
)
def test_a_wrong_file_is_one_sentence_and_nothing_is_written(
    kind: str, sentence: str, tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    file = damaged(kind, tmp_path)
    before = contents(tmp_path)
    with pytest.raises(InputError, match=sentence) as raised:
        train(replace(ON_CLIP["cliport-rn50"], clip_weights=file), BRIEF, demonstrations, data, tmp_path / "run")
    assert "\n" not in str(raised.value)
    assert contents(tmp_path) == before


def test_an_unknown_tower_names_the_nearest() -> None:
    with pytest.raises(InputError, match="no CLIP 'clip-rn5'; did you mean 'clip-rn50'"):
        models.build(replace(models.MODELS["cliport-rn50"], tower="clip-rn5"))
    with pytest.raises(InputError, match="stands on a CLIP"):
        models.build(replace(models.MODELS["leg-unet"], phi="two-stream"))
    with pytest.raises(InputError, match="four widths"):
        models.build(replace(ON_CLIP["cliport-rn50"], semantic_widths=(8, 8)))
    with pytest.raises(InputError, match="leg-cliport has stride 1, but the phi 'two-stream' has 2"):
        models.build(replace(ON_CLIP["leg-cliport"], stride=1))


def test_random_text_weights_read_nothing() -> None:
    policy = models.build(replace(ON_CLIP["cliport-rn50"], text_encoder="clip"))
    with pytest.raises(InputError, match="random weights reads no instruction; use the text encoder 'minilm'"):
        policy.embed("the mug")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--model", "cliport-rn50"], "the weights of clip-rn50 are not on this machine and there is no network"),
        (["--model", "cliport-vit", "--clip-weights", "none.safetensors"], "is not one on this machine"),
        (["--model", "leg-unet", "--clip-weights", "random"], "leg-unet has no CLIP"),
    ],
    ids=str,
)
def test_the_command_says_what_is_missing_before_it_looks_at_the_data(
    arguments: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["train", "--data", str(tmp_path / "none"), "--out", str(tmp_path / "run"), *arguments])
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1
    assert not contents(tmp_path)


def test_the_difference_of_two_rows_is_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    main(["models", "--diff", "leg-unet", "leg-unet-no-steerability"])
    assert capsys.readouterr().out == "kernel: lifted -> plain\n"
    with pytest.raises(SystemExit):
        main(["models", "--diff", "leg-unet", "cliport-rn5"])
    assert "did you mean 'cliport-rn50'" in capsys.readouterr().err


def test_counted_models_have_their_parameters_and_what_is_frozen(capsys: pytest.CaptureFixture[str]) -> None:
    main(["models", "--count"])
    said = capsys.readouterr().out
    assert "3.07 M trainable parameters (the paper: 3.3 M)" in said
    assert "93.55 M trainable parameters, and 23.5 M frozen (the paper: 94.0 M)" in said


# The real thing


@pytest.mark.slow
def test_the_real_rn50_loads_from_a_file_of_its_own_layout(tmp_path: Path) -> None:
    path = tmp_path / "RN50.safetensors"
    expected = weights_of("clip-rn50", path, "openai")
    loaded = ClipImage("clip-rn50", str(path)).visual.state_dict()
    assert len(loaded) > 300
    for key, value in loaded.items():
        torch.testing.assert_close(value.float(), expected[f"visual.{key}"], rtol=0, atol=0)
    start = time.process_time()
    with pytest.raises(InputError, match="but those of clip-rn50"):
        clip.find_weights("clip-vit-b-32", str(path))
    assert time.process_time() - start < 2, "a header is read, not 200 MB"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cliport-rn50", "leg-cliport"])
def test_a_full_model_on_random_towers_can_learn_two_grasps(name: str, demonstrations: list[Demonstration]) -> None:
    row: ModelConfig = replace(models.MODELS[name], clip_weights="random", text_encoder="hashing")
    policy, few = models.build(row), demonstrations[:2]
    observations = torch.stack([to_tensor(each.observation) for each in few])
    embeddings = torch.stack([policy.embed(each.instruction) for each in few])
    read_out = policy.read_out(WORKSPACE.shape)
    labels = torch.tensor([read_out.label(each.grasp) for each in few])
    adam = torch.optim.Adam([each for each in policy.parameters() if each.requires_grad], lr=3e-4)
    for _ in range(200):
        scores = policy.logits(observations, embeddings).flatten(1)
        if torch.equal(scores.argmax(dim=1), labels):
            break
        adam.zero_grad()
        torch.nn.functional.cross_entropy(scores, labels).backward()
        adam.step()
    assert torch.equal(policy.logits(observations, embeddings).flatten(1).argmax(dim=1), labels)

"""An exported policy says what the policy says, in a process that has never seen equigrasp or escnn."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from equigrasp import export as export_module
from equigrasp import models
from equigrasp.cli import main
from equigrasp.correlation import correlate_even
from equigrasp.errors import InputError
from equigrasp.export import export, noise, writer
from equigrasp.grasp import Demonstration, Observation
from equigrasp.plan import PLAN, Training
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy
from equigrasp.reference_head import correlate_directly
from equigrasp.training import train

SHAPE = (64, 96)
ELSEWHERE = """
import sys
import numpy, torch
program = torch.export.load(sys.argv[1], extra_files=(extra := {"equigrasp.json": ""})).module()
given = numpy.load(sys.argv[2])
with torch.no_grad():
    found = program(torch.from_numpy(given["observation"]), torch.from_numpy(given["embedding"]))
assert not {"equigrasp", "escnn"} & set(sys.modules)
numpy.savez(sys.argv[3], found=found.numpy(), extra=extra["equigrasp.json"])
"""
"""A stranger's process; torch reads its own file, in a process of its own, because reading one may unpickle."""


def built(name: str, seed: int = 0) -> GraspPolicy:
    return models.build(replace(models.MODELS[name], text_encoder="hashing"), seed)


def expected(policy: GraspPolicy, scene: tuple[torch.Tensor, torch.Tensor]) -> np.ndarray:
    policy.eval()
    policy.precision = "float32"
    with torch.no_grad():
        return policy.log_probabilities(*scene).numpy()


def test_a_torch_program_says_the_same_elsewhere(tmp_path: Path) -> None:
    policy, scene = built("leg-steerable"), noise(512, SHAPE, seed=7)
    policy.precision = "bfloat16"  # whatever it computes in here, its file computes in float32
    agreement = export(policy, tmp_path / "policy.pt2", SHAPE)
    assert agreement.largest < 1e-5
    np.savez(tmp_path / "given.npz", observation=scene[0].numpy(), embedding=scene[1].numpy())
    given, found = tmp_path / "given.npz", tmp_path / "found.npz"
    subprocess.run([sys.executable, "-c", ELSEWHERE, tmp_path / "policy.pt2", given, found], check=True, cwd=tmp_path)
    with np.load(found, allow_pickle=False) as result:
        np.testing.assert_allclose(result["found"], expected(policy, scene), rtol=0, atol=1e-5)
        said = json.loads(str(result["extra"]))
    assert (said["model"], said["text_encoder"], said["stride"]) == ("leg-steerable", "hashing", "2")


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable", "fcgq"])
def test_an_onnx_file_says_the_same(tmp_path: Path, name: str) -> None:
    onnxruntime = pytest.importorskip("onnxruntime")
    policy, scene = built(name), noise(512, SHAPE, seed=7)
    agreement = export(policy, tmp_path / "policy.onnx", SHAPE)
    assert agreement.largest < 1e-4 < 0.01 * agreement.spread
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx", providers=["CPUExecutionProvider"])
    (found,) = session.run(None, {"observation": scene[0].numpy(), "embedding": scene[1].numpy()})
    np.testing.assert_allclose(found, expected(policy, scene), rtol=0, atol=1e-4)
    assert session.get_modelmeta().custom_metadata_map["model"] == name


@pytest.mark.parametrize("name", [name for name, row in models.MODELS.items() if row.encoder == "minilm"])
def test_every_model_without_clip_becomes_a_torch_program(tmp_path: Path, name: str) -> None:
    assert export(built(name), tmp_path / "policy.pt2", SHAPE).largest < 1e-4


def test_the_convolution_is_the_correlation() -> None:
    """In float64, so that the tolerance leaves no room for another kernel, and one that is turned over is noticed."""
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(2, 3, 20, 30, dtype=torch.float64, generator=generator)
    half = torch.randn(2, 5, 3, 9, 9, dtype=torch.float64, generator=generator)
    even = half + half.flip((3, 4))
    found = correlate_directly(features, even)
    torch.testing.assert_close(found, correlate_even(features, even), rtol=0, atol=1e-12)
    assert (correlate_directly(features, even.flip(3)) - found).abs().max() > 1


def test_a_wrong_convolution_would_be_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxruntime")
    monkeypatch.setattr(
        export_module, "correlate_directly", lambda image, taps: correlate_directly(image, taps.flip(3))
    )
    agreement = export(built("leg-steerable"), tmp_path / "policy.onnx", SHAPE)
    assert agreement.largest > 0.01 * agreement.spread


def test_the_policy_stays_as_it_was(tmp_path: Path) -> None:
    policy = built("leg-steerable").train()
    assert isinstance(policy, LegPolicy)
    before = policy.correlate, policy.precision, {name: each.clone() for name, each in policy.state_dict().items()}
    pytest.importorskip("onnxruntime")
    export(policy, tmp_path / "policy.onnx", SHAPE)
    assert (policy.correlate, policy.precision) == before[:2]
    assert policy.training
    assert policy.phi.training
    assert all(torch.equal(each, before[2][name]) for name, each in policy.state_dict().items())


def test_what_is_frozen_stays_frozen(tmp_path: Path) -> None:
    policy = built("leg-steerable").train()
    next(policy.children()).eval()
    before = [each.training for each in policy.modules()]
    export(policy, tmp_path / "policy.pt2", SHAPE)
    assert [each.training for each in policy.modules()] == before


@pytest.mark.parametrize("place", [torch.float64, torch.bfloat16, "meta"])
def test_weights_of_another_dtype_or_place_are_refused(tmp_path: Path, place: torch.dtype | str) -> None:
    with pytest.raises(InputError, match=r"float32 weights on the CPU, but .* is torch\..*; export a copy"):
        export(built("fcgq").to(place), tmp_path / "policy.pt2", SHAPE)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".pt2", ".onnx"])
def test_a_file_is_the_same_each_time_and_does_not_say_where_it_was_made(tmp_path: Path, suffix: str) -> None:
    """No folder of this machine: not the package's, torch's or the one that the command ran in."""
    if suffix == ".onnx":
        pytest.importorskip("onnxruntime")
    out = tmp_path / f"policy{suffix}"
    export(built("fcgq"), out, SHAPE)
    contents = [out.read_bytes()]
    export(built("fcgq"), out, SHAPE)
    assert contents == [out.read_bytes()]
    if suffix == ".pt2":
        with zipfile.ZipFile(out) as archive:
            contents += [archive.read(name) for name in archive.namelist()]
    package, libraries = Path(export_module.__file__).parent, Path(torch.__file__).parent.parent
    for place in (package, libraries, Path.cwd(), tmp_path):
        assert not any(str(place).encode() in each for each in contents), place


class Forbids(torch.nn.Module):
    """A network that allows a grasp where something is higher than that, in metres."""

    stride = 2

    def __init__(self, height: float) -> None:
        super().__init__()
        self.height = height

    def forward(self, observation: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        scores = torch.nn.functional.avg_pool2d(observation[:, :1] / 255, 2).expand(-1, 36, -1, -1)
        return scores.masked_fill(observation[:, 3:, ::2, ::2] < self.height, -torch.inf)


def test_what_is_forbidden_is_forbidden_in_the_file_and_no_difference(tmp_path: Path) -> None:
    found = export(DensePolicy(Forbids(0.05), "hashing"), tmp_path / "policy.pt2", SHAPE)
    assert found.largest == 0
    assert 0 < found.spread < 10
    one, other = torch.tensor([[0.5, -torch.inf]]), torch.tensor([[0.25, -3.0]])
    assert export_module.agreement(one, one) == export_module.Agreement(0.0, 0.0)
    assert export_module.agreement(one, other) == export_module.Agreement(torch.inf, 3.25)
    assert export_module.agreement(other, one) == export_module.Agreement(torch.inf, 0.0)
    with pytest.raises(InputError, match="the program made of the policy gives log-probabilities of which none"):
        export_module.agreement(one * torch.nan, one)


def test_it_is_compared_on_what_was_seen_too(tmp_path: Path) -> None:
    """Noise averaged over a cell is never black or white, which is what spreads these scores the most."""
    policy = DensePolicy(Forbids(-1.0), "hashing")
    rows, columns = SHAPE
    half = np.zeros((rows, columns, 3), np.uint8)
    half[:, : columns // 2] = 255
    seen = Observation(half, np.zeros(SHAPE, np.float32))
    alone = export(policy, tmp_path / "alone.pt2", SHAPE)
    both = export(policy, tmp_path / "both.pt2", SHAPE, [(seen, "pick up the mug")])
    assert both.spread == pytest.approx(1.0, abs=1e-5)
    assert alone.spread < 0.999
    with pytest.raises(InputError, match=r"Observation\(64x96.*takes heightmaps of \(64, 64\) pixels"):
        export(policy, tmp_path / "small.pt2", (64, 64), [(seen, "pick up the mug")])
    assert not (tmp_path / "small.pt2").exists()


def test_the_command_compares_on_scenes_of_the_suites_tasks(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration], capsys: pytest.CaptureFixture[str]
) -> None:
    model = replace(models.MODELS["fcgq"], widths=(8, 8, 16, 16, 16), text_encoder="hashing")  # type: ignore[call-arg]
    train(model, Training(steps=1, seed=0, threads=1), demonstrations, data, tmp_path / "run")
    plan = json.loads((tmp_path / "run" / PLAN).read_text())
    for task, scenes in (
        ("pick-by-part", "3 scenes of noise and 3 of pick-by-part"),
        ("my-table", "3 scenes of noise"),
    ):
        (tmp_path / "run" / PLAN).write_text(json.dumps({**plan, "task": task}))
        main(["export", "--run", str(tmp_path / "run"), "--out", str(tmp_path / f"{task}.pt2")])
        assert f"on {scenes} its log-probabilities are within" in capsys.readouterr().out


def test_a_policy_without_a_best_grasp_is_not_written(tmp_path: Path) -> None:
    broken = built("fcgq")
    with torch.no_grad():
        next(broken.parameters()).fill_(torch.nan)
    for policy in (broken, DensePolicy(Forbids(0.2), "hashing")):
        with pytest.raises(InputError, match="DensePolicy gives log-probabilities of which none is the best") as error:
            export(policy, tmp_path / "new" / "policy.pt2", SHAPE)
        assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


class Asks(torch.nn.Module):
    """A network that does one thing or another, by what it sees: no one program does both."""

    stride = 2

    def forward(self, observation: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        scores = torch.zeros(len(observation), 36, observation.shape[2] // 2, observation.shape[3] // 2)
        return scores if observation.sum() > 0 else scores + 1


def test_what_cannot_be_exported_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = DensePolicy(Asks(), "hashing")
    with pytest.raises(InputError, match="DensePolicy cannot be exported") as error:
        export(policy, tmp_path / "policy.pt2", SHAPE)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match=r"no format of an exported policy '\.bin'"):
        export(policy, tmp_path / "policy.bin", SHAPE)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[onnx\]'"):
        export(policy, tmp_path / "policy.onnx", SHAPE)


def test_without_a_temporary_folder_it_is_said_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere() -> str:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr("tempfile.gettempdir", nowhere)
    for name in ("policy.pt2", "policy.onnx"):
        with pytest.raises(InputError, match="no temporary folder can be written; set TMPDIR to a folder of yours"):
            writer(tmp_path / name)


def test_the_command_refuses_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "there.pt2").write_bytes(b"")
    for out, sentence in (("policy.bin", "must end in .pt2 or .onnx"), ("there.pt2", "exists"), ("a.pt2", "not a run")):
        with pytest.raises(SystemExit):
            main(["export", "--run", str(tmp_path), "--out", str(tmp_path / out)])
        said = capsys.readouterr().err
        assert sentence in said
        assert said.count("\n") == 1


def test_a_file_says_the_encoders_weights_by_their_name_alone() -> None:
    """Where they lie on this machine is nobody's business."""
    policy = built("fcgq")
    for encoder, said in (
        ("clip-rn50:/home/somebody/secret/RN50.safetensors", "clip-rn50:RN50.safetensors"),
        ("clip-rn50", "clip-rn50"),
        ("hashing", "hashing"),
    ):
        policy.text_encoder = encoder
        assert export_module.metadata(policy, SHAPE)["text_encoder"] == said


def test_a_file_says_how_cells_and_bins_become_a_grasp() -> None:
    policy = built("leg-steerable")
    assert isinstance(policy, LegPolicy)
    for each, bins in ((policy, "36"), (policy.at(72), "72")):
        said = export_module.metadata(each, SHAPE)
        assert (said["bins"], said["stride"], said["height_width"]) == (bins, "2", "64 96")

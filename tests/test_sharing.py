"""A saved policy is the policy, wherever it is loaded; its card says what was measured; nothing else is believed."""

from __future__ import annotations

import json
import pickle
import shutil
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from folders import contents
from huggingface_hub import HfApi, ModelCard, constants
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from equigrasp import hub
from equigrasp.cli import main
from equigrasp.config import CliportConfig, ModelConfig
from equigrasp.encoder import UNet
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS, build
from equigrasp.plan import PLAN, STAMP, WEIGHTS, Training
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy
from equigrasp.sharing import shareable
from equigrasp.success import MeanReward, Rate
from equigrasp.training import CHECKPOINT, LOG, load_policy, train
from equivariance_tests.check import check_equivariance

LEG: dict[str, Any] = {"kernel_size": 17, "maximum_frequency": 4, "channels": 4, "text_encoder": "hashing"}
SMALL: dict[str, ModelConfig] = {
    "steerable": replace(MODELS["leg-steerable"], **LEG, widths=(8, 8, 16, 16, 16)),
    "lifted": replace(MODELS["leg-unet"], **LEG, widths=(8, 8, 16, 16, 16)),
    "equivariant": replace(MODELS["leg-equivariant"], **LEG, widths=(8, 8, 8, 8, 8)),
    "dense": replace(MODELS["fcgq"], widths=(8, 8, 16, 16, 16), text_encoder="hashing"),
}
BRIEF = Training(steps=2, seed=3, threads=1)


def scores(policy: GraspPolicy) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    scene = torch.rand(1, 4, 64, 64, generator=generator) * torch.tensor([255, 255, 255, 0.1]).view(4, 1, 1)
    with torch.no_grad():
        return policy.eval().logits(scene, torch.randn(1, 512, generator=generator))


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """No server answers; every address that was tried."""
    tried: list[Any] = []

    def refuse(address: Any, timeout: float | None = None, **_: Any) -> None:
        tried.append((address, timeout))
        raise OSError("no network")

    monkeypatch.setattr(socket, "create_connection", refuse)
    return tried


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, data: Path, demonstrations: list[Demonstration]) -> Path:
    run = tmp_path_factory.mktemp("sharing") / "run"
    train(SMALL["steerable"], BRIEF, demonstrations, data, run)
    return run


@pytest.fixture
def copy(tmp_path: Path, run: Path) -> Path:
    """A copy of the run that a test may change."""
    shutil.copytree(run, tmp_path / "copy")
    return tmp_path / "copy"


# The round trip


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("training", [True, False], ids=["training", "acting"])
def test_what_is_loaded_is_what_was_saved(name: str, training: bool, tmp_path: Path) -> None:
    policy = build(SMALL[name], seed=5).train(training)
    policy.save_pretrained(tmp_path / "saved")
    assert sorted(contents(tmp_path / "saved")) == ["README.md", "config.json", "model.safetensors"]
    loaded = GraspPolicy.from_pretrained(tmp_path / "saved")
    assert torch.equal(scores(loaded), scores(policy))
    assert not loaded.training
    assert type(loaded) is type(policy)
    assert loaded.config == SMALL[name]
    loaded.save_pretrained(tmp_path / "again")
    assert contents(tmp_path / "again") == contents(tmp_path / "saved")


def test_one_weight_that_is_another_would_be_noticed(tmp_path: Path) -> None:
    """The law above fails for a file with one other number."""
    policy = build(SMALL["dense"], seed=5)
    policy.save_pretrained(tmp_path)
    tensors = load_file(tmp_path / "model.safetensors")
    next(iter(tensors.values())).view(-1)[0] += 1
    save_file(tensors, tmp_path / "model.safetensors")
    assert not torch.equal(scores(GraspPolicy.from_pretrained(tmp_path)), scores(policy))


def test_a_run_is_a_saved_policy_and_a_saved_policy_of_a_run_is_a_run(run: Path, tmp_path: Path) -> None:
    trained = load_policy(run)
    loaded = LegPolicy.from_pretrained(str(run))
    assert torch.equal(scores(loaded), scores(trained))
    loaded.save_pretrained(tmp_path)
    assert json.loads((tmp_path / PLAN).read_text()) == json.loads((run / PLAN).read_text())
    assert (tmp_path / WEIGHTS).read_bytes() == (run / WEIGHTS).read_bytes()
    assert torch.equal(scores(load_policy(tmp_path)), scores(trained))


def test_a_subclass_loads_its_own_alone(run: Path) -> None:
    with pytest.raises(InputError, match=r"holds a LegPolicy, not a DensePolicy"):
        DensePolicy.from_pretrained(run)


def test_a_policy_put_together_by_hand_says_how_to_save_it(tmp_path: Path) -> None:
    policy = DensePolicy(UNet(512, 36, 2, (8, 8, 16, 16, 16)), "hashing")
    with pytest.raises(InputError, match=r"put together by hand.*my_policy"):
        policy.save_pretrained(tmp_path)
    assert not contents(tmp_path)
    build(SMALL["dense"]).save_pretrained(tmp_path)
    before = contents(tmp_path)
    with pytest.raises(InputError, match="put together by hand"):
        policy.save_pretrained(tmp_path)
    assert contents(tmp_path) == before


def test_a_card_goes_with_its_model_and_stays_with_its_weights(tmp_path: Path) -> None:
    card = tmp_path / "README.md"
    build(SMALL["dense"], seed=5).save_pretrained(tmp_path)
    measured = card.read_text() + "\nMeasured elsewhere: 92.4%.\n"
    card.write_text(measured)
    GraspPolicy.from_pretrained(tmp_path).save_pretrained(tmp_path)
    assert card.read_text() == measured
    build(SMALL["dense"], seed=6).save_pretrained(tmp_path)
    assert "92.4%" not in card.read_text()
    build(SMALL["steerable"]).save_pretrained(tmp_path)
    assert "# leg-steerable" in card.read_text().splitlines()


@pytest.mark.parametrize(
    "text", ["# fcgq\n\nA policy of equigrasp: mine.\n", "---\nlibrary_name: timm\n---\n\n# fcgq\n", "\xff"]
)
def test_a_readme_of_somebody_elses_stays(text: str, tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text(text, encoding="latin-1")
    before = (tmp_path / "README.md").read_bytes()
    build(SMALL["dense"]).save_pretrained(tmp_path)
    assert (tmp_path / "README.md").read_bytes() == before


# The hub, without a network


def in_cache(folder: Path, cache: Path, name: str) -> None:
    """Lay a folder down as huggingface_hub would, had it been fetched."""
    root = cache / f"models--{name.replace('/', '--')}"
    (root / "refs").mkdir(parents=True)
    (root / "refs" / "main").write_text("0" * 40)
    shutil.copytree(folder, root / "snapshots" / ("0" * 40))


def test_a_fetched_model_is_loaded_without_a_network(run: Path, tmp_path: Path) -> None:
    load_policy(run).save_pretrained(tmp_path / "saved")
    in_cache(tmp_path / "saved", tmp_path / "cache", "somebody/grasps")
    loaded = GraspPolicy.from_pretrained("somebody/grasps", cache_dir=tmp_path / "cache")
    assert torch.equal(scores(loaded), scores(load_policy(run)))


def test_what_is_nowhere_is_one_sentence_after_one_try(tmp_path: Path, no_network: list[Any]) -> None:
    with pytest.raises(InputError, match=r"no folder somebody/grasps here.*cannot be asked") as error:
        GraspPolicy.from_pretrained("somebody/grasps", cache_dir=tmp_path)
    assert "\n" not in str(error.value)
    assert [timeout for _, timeout in no_network].count(1.5) == 1


def test_offline_means_not_even_a_try(tmp_path: Path, no_network: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    with pytest.raises(InputError, match="HF_HUB_OFFLINE"):
        GraspPolicy.from_pretrained("somebody/grasps", cache_dir=tmp_path)
    assert not no_network


@pytest.mark.parametrize("name", ["runs/of/mine", "a name", ""])
def test_what_is_neither_folder_nor_id_is_refused(name: str, no_network: list[Any], monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"neither a folder here nor|holds no saved policy"):
        GraspPolicy.from_pretrained(name)
    assert not no_network


def test_a_downloaded_file_chooses_no_code(tmp_path: Path) -> None:
    """A config's family is a module to import: from a folder of one's own, yes, from the hub not unasked."""
    build(SMALL["dense"]).save_pretrained(tmp_path / "saved")
    config = json.loads((tmp_path / "saved" / "config.json").read_text())
    config["model"]["family"] = "antigravity:Config"
    (tmp_path / "saved" / "config.json").write_text(json.dumps(config))
    in_cache(tmp_path / "saved", tmp_path / "cache", "somebody/grasps")
    with pytest.raises(InputError, match=r"`import antigravity` before"):
        GraspPolicy.from_pretrained("somebody/grasps", cache_dir=tmp_path / "cache")


@pytest.fixture
def uploads(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """A hub that answers, and what would be uploaded to it."""
    uploaded: list[dict[str, Any]] = []

    class Repository:
        repo_id = "somebody/grasps"

    def upload(self: HfApi, *, folder_path: Path, **options: Any) -> str:
        uploaded.append({**options, "files": contents(Path(folder_path))})
        return "https://hub/somebody/grasps/commit/1"

    monkeypatch.setattr(hub, "is_online", lambda: True)
    monkeypatch.setattr(HfApi, "create_repo", lambda self, repo_id, **_: Repository)
    monkeypatch.setattr(HfApi, "upload_folder", upload)
    return uploaded


def test_what_is_pushed_is_what_is_saved(run: Path, tmp_path: Path, uploads: list[dict[str, Any]]) -> None:
    policy = load_policy(run)
    policy.save_pretrained(tmp_path / "saved")
    assert policy.push_to_hub("somebody/grasps", private=True).startswith("https://")
    [upload] = uploads
    assert upload["files"] == contents(tmp_path / "saved")
    assert (upload["repo_id"], upload["repo_type"]) == ("somebody/grasps", "model")


def test_paths_of_this_machine_are_not_pushed() -> None:
    config = CliportConfig(
        name="on-clip",
        summary="",
        tower="clip-rn50",
        semantic_widths=(16, 16, 8, 8),
        widths=(8, 8, 16, 16, 16),
        clip_weights="/home/me/RN50.safetensors",
    )
    for each in (config, config.untrained()):
        assert "/home/me" not in json.dumps(shareable.portable(each).to_dict())
    assert shareable.portable(SMALL["dense"]) == SMALL["dense"]


def test_pushing_without_a_network_is_one_sentence(run: Path, tmp_path: Path, capsys: Any) -> None:
    with pytest.raises(InputError, match="cannot be pushed: the hub does not answer"):
        load_policy(run).push_to_hub("somebody/grasps")
    before = contents(tmp_path)
    with pytest.raises(SystemExit):
        main(["share", "--run", str(run), "--out", str(tmp_path / "out"), "--push", "somebody/grasps"])
    assert "cannot be pushed" in capsys.readouterr().err
    assert contents(tmp_path) == before


def test_a_hub_that_refuses_is_one_sentence(run: Path, uploads: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: HfApi, **_: Any) -> None:
        raise OSError("401")

    monkeypatch.setattr(HfApi, "create_repo", refuse)
    with pytest.raises(InputError, match="hf auth login"):
        load_policy(run).push_to_hub("somebody/grasps")


# The card and the command


def shared(run: Path, out: Path, *options: str) -> Any:
    main(["share", "--run", str(run), "--out", str(out), *options])
    return ModelCard.load(out / "README.md")


def test_a_card_says_what_was_not_measured(run: Path, tmp_path: Path) -> None:
    card = shared(run, tmp_path / "out")
    assert card.text.count("Not measured.") == 2
    assert "| Task | pick-by-part |" in card.text
    assert "| Training steps | 2 |" in card.text
    assert "| Text encoder | hashing |" in card.text
    assert card.data.license == "mit"
    assert card.data.eval_results is None
    assert sorted(contents(tmp_path / "out")) == ["README.md", PLAN, WEIGHTS]
    assert torch.equal(scores(load_policy(tmp_path / "out")), scores(load_policy(run)))


def test_a_card_says_how_its_scenes_were_put_together(copy: Path, tmp_path: Path) -> None:
    plan = json.loads((copy / PLAN).read_text())
    plan["training"] |= {"recombination": 0.7, "hard_negatives": 0.25, "crowded": 0.4}
    (copy / PLAN).write_text(json.dumps(plan))
    text = shared(copy, tmp_path / "out").text
    assert "| Recombined examples | 0.7 |" in text
    assert "| Of these with hard negatives | 0.25 |" in text
    assert "| Of these crowded | 0.4 |" in text


def test_a_card_has_what_was_measured_and_no_other_weights(
    copy: Path, tmp_path: Path, uploads: list[dict[str, Any]]
) -> None:
    evaluate = ["evaluate", "--run", str(copy), "--protocol", "single-shot", "--threads", "1", "--scenes"]
    main([*evaluate, "2"])
    [path] = (copy / "evaluations").glob("*.json")
    counts = json.loads(path.read_text())
    of_kept_weights = counts | {"step": 1, "phrasings": "unseen"}
    path.with_name("step-1.json").write_text(json.dumps(of_kept_weights))
    report = check_equivariance(load_policy(copy), ["fourier", "bins turn", "policy: quarter turn"])
    (copy / "equivariance").mkdir()
    measured = {"report": report.to_dict(), "run": json.loads((copy / PLAN).read_text())}
    (copy / "equivariance" / "equivariance.json").write_text(json.dumps(measured))
    card = shared(copy, tmp_path / "out", "--license", "cc-by-4.0", "--push", "somebody/grasps")
    assert "in each of 2 unseen scenes" in card.text
    assert "unseen |" not in card.text
    for actor in ("policy", "oracle"):
        rate = counts[actor]["rates"]["correct"]
        assert str(Rate(rate["successes"], rate["trials"])) in card.text
    for finding in report.findings:
        assert f"| {finding.law.name} |" in card.text
        assert finding.verdict is not None
        assert f"{finding.verdict.value:.2g}" in card.text
    assert "| fails |" in card.text  # a plain U-Net does not turn
    assert "Not measured." not in card.text
    assert card.data.license == "cc-by-4.0"
    rates = {result.metric_name: result.metric_value for result in card.data.eval_results}
    assert rates["right grasps"] == counts["policy"]["rates"]["correct"]["successes"] / 2
    assert uploads[0]["files"] == contents(tmp_path / "out")


def test_every_number_of_a_card_is_the_one_that_was_counted(copy: Path, tmp_path: Path) -> None:
    """No two of these counts are alike, so that one in another's place is seen."""
    plan = json.loads((copy / PLAN).read_text())
    (copy / "evaluations").mkdir()

    def counts(**successes: int) -> dict[str, Any]:
        return {name: {"successes": count, "trials": 10} for name, count in successes.items()}

    single = counts(grasped=9, correct_object=7, correct=4)
    paper = counts(grasped=8, correct_object=6, correct=3, reached=2) | {"reward": 0.55, "scenes": 5}
    oracle = counts(grasped=10, correct_object=9, correct=8)
    said = {"run": plan, "step": BRIEF.steps, "task": "pick-by-part", "phrasings": "unseen", "camera": "fused"}
    for seed, (protocol, rates) in enumerate({"single-shot": single, "paper": paper}.items(), start=11):
        measured = {"policy": {"rates": rates}, "oracle": {"rates": oracle}} if protocol == "single-shot" else {}
        values = said | {"protocol": protocol, "seed": seed, "policy": {"rates": rates}} | measured
        (copy / "evaluations" / f"{protocol}.json").write_text(json.dumps(values))
    card = shared(copy, tmp_path / "out")
    lines = card.text.splitlines()
    header = next(index for index, line in enumerate(lines) if line.startswith("| task |"))
    columns, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines[header : header + 4]]
    shown = {row["scenes' seed"]: row for row in (dict(zip(columns, each, strict=True)) for each in rows)}
    assert shown["11"] == {
        "task": "pick-by-part",
        "phrasings": "unseen",
        "protocol": "one grasp in each of 10 unseen scenes",
        "camera": "fused",
        "scenes' seed": "11",
        "right": str(Rate(4, 10)),
        "right object": str(Rate(7, 10)),
        "mean reward": "",
        "oracle, right": str(Rate(8, 10)),
    }
    assert shown["12"] == {
        "task": "pick-by-part",
        "phrasings": "unseen",
        "protocol": "the paper's, n + 1 trials for n goals in each of 5 unseen scenes",
        "camera": "fused",
        "scenes' seed": "12",
        "right": str(Rate(3, 10)),
        "right object": str(Rate(6, 10)),
        "mean reward": str(MeanReward(0.55, 5)),
        "oracle, right": "not measured",
    }
    assert {
        (result.dataset_name, result.dataset_args["seed"], result.metric_name): result.metric_value
        for result in card.data.eval_results
    } == {
        ("pick-by-part, unseen phrasings, single-shot", 11, "right grasps"): 0.4,
        ("pick-by-part, unseen phrasings, single-shot", 11, "right object"): 0.7,
        ("pick-by-part, unseen phrasings, paper", 12, "right grasps"): 0.3,
        ("pick-by-part, unseen phrasings, paper", 12, "right object"): 0.6,
    }


def test_another_runs_evaluation_is_refused(copy: Path, tmp_path: Path) -> None:
    (copy / "evaluations").mkdir()
    plan = json.loads((copy / PLAN).read_text())
    foreign = {"run": plan | {"demos": 10}, "step": 2, "protocol": "paper"}
    path = copy / "evaluations" / "one.json"
    for values, sentence in ((foreign, "not an evaluation of this run"), (foreign | {"run": plan}, "is damaged")):
        path.write_text(json.dumps(values))
        with pytest.raises(InputError, match=sentence):
            sharing_of(copy, tmp_path)
    assert not (tmp_path / "out").exists()


def test_another_runs_laws_are_refused(copy: Path, tmp_path: Path) -> None:
    plan = json.loads((copy / PLAN).read_text())
    (copy / "equivariance").mkdir()
    path = copy / "equivariance" / "equivariance.json"
    for run in (plan | {"demos": 10}, None):
        path.write_text(json.dumps({"report": {"laws": []}, "run": run}))
        with pytest.raises(InputError, match=r"equivariance.json is not of this run; .* makes one"):
            sharing_of(copy, tmp_path)
    assert not list(tmp_path.glob("*out"))
    path.write_text(json.dumps({"report": {"laws": []}, "run": plan}))
    sharing_of(copy, tmp_path)


def sharing_of(run: Path, folder: Path) -> None:
    from equigrasp.cli.share import Share

    Share(run=run, out=folder / "out").execute()


# What is not believed


class Malicious(nn.Module):
    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path("unpickled"),)


def edit(folder: Path, **changes: Any) -> None:
    path = folder / PLAN
    values = json.loads(path.read_text())
    values["model"] |= changes
    path.write_text(json.dumps(values))


def spoil(folder: Path, how: str) -> None:
    weights = folder / WEIGHTS
    if how == "truncated":
        weights.write_bytes(weights.read_bytes()[:-100])
    elif how == "another model's":
        weights.write_bytes(shareable.packed(build(SMALL["dense"]).state_dict()))
    elif how == "a checkpoint":
        shutil.copy(folder / CHECKPOINT, weights)
    elif how in ("a pickle", "a pickle by the right name"):
        name = WEIGHTS if "right" in how else "pytorch_model.bin"
        weights.unlink()
        (folder / name).write_bytes(pickle.dumps(Malicious()))
    elif how == "a stamp that is a list":
        weights.write_bytes(shareable.packed(load_file(weights), {STAMP: "[1]"}))
    elif how in ("no weights", "a folder by the right name"):
        weights.unlink()
        if "folder" in how:
            weights.mkdir()
    elif how == "no config":
        (folder / PLAN).unlink()
    elif how == "config of nobody's":
        (folder / PLAN).write_text('{"architectures": ["BertModel"]}')


BAD_FILES = {
    "truncated": "is damaged or another model's",
    "another model's": r"is damaged or another model's \(Missing key",
    "a checkpoint": r"is damaged or another model's \(Missing key",
    "a pickle": r"pytorch_model.bin is not read: a pickle",
    "a pickle by the right name": "is damaged or another model's",
    "a stamp that is a list": r"is damaged or another model's \(its stamp is \[1\]",
    "a folder by the right name": "is damaged or another model's",
    "no weights": "has no (weights )?model.safetensors",
    "no config": "no config.json",
    "config of nobody's": "model is missing",
}
BAD_CONFIGS: dict[str, tuple[dict[str, Any], str]] = {
    "family": ({"family": "legg"}, "no family of models 'legg'; did you mean 'leg'"),
    "module": ({"family": "nowhere_at_all:Config"}, "'nowhere_at_all' cannot be imported"),
    "class": ({"family": "pathlib:Path"}, "pathlib:Path is no family of models"),
    "kernel": ({"kernel": "steerible"}, "its kernel is 'steerable', and by the config.json beside it 'steerible'"),
    "setting": ({"kernel_sise": 3}, "did you mean 'kernel_size'"),
    "text encoder": ({"text_encoder": "minilmm"}, "no text encoder 'minilmm'; did you mean 'minilm'"),
}


@pytest.mark.parametrize("read", [GraspPolicy.from_pretrained, load_policy])
@pytest.mark.parametrize("how", BAD_FILES)
def test_a_bad_file_is_one_sentence_and_runs_nothing(
    how: str, read: Any, copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(copy, how)
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    of_a_run = {"no config": "is not a run folder", "a pickle": "has no weights"} if read is load_policy else {}
    with pytest.raises(InputError, match=of_a_run.get(how, BAD_FILES[how])) as error:
        read(copy)
    assert "\n" not in str(error.value)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("changes", BAD_CONFIGS)
@pytest.mark.parametrize("command", ["evaluate", "share", "show"])
def test_a_bad_config_is_one_sentence_and_nothing_is_written(
    changes: str, command: str, copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    values, sentence = BAD_CONFIGS[changes]
    edit(copy, **values)
    before = contents(tmp_path)
    monkeypatch.setattr("equigrasp.cli.policy.make_env", pytest.fail)
    monkeypatch.setattr("equigrasp.cli.pictures.make_env", pytest.fail)
    with pytest.raises(SystemExit):
        main([command, "--run", str(copy), *(["--out", str(tmp_path / "out")] if command == "share" else [])])
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert sentence in errors[0]
    assert contents(tmp_path) == before


@pytest.mark.parametrize("command", ["evaluate", "show"])
def test_an_encoder_that_is_not_here_is_said_before_a_simulator_starts(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, run: Path
) -> None:
    monkeypatch.setattr("equigrasp.cli.policy.make_env", pytest.fail)
    monkeypatch.setattr("equigrasp.cli.pictures.make_env", pytest.fail)
    monkeypatch.setattr("huggingface_hub.try_to_load_from_cache", lambda *_: None)
    monkeypatch.setenv("EQUIGRASP_CACHE", str(tmp_path / "cache"))
    policy = build(replace(SMALL["dense"], text_encoder="clip-rn50"))
    policy.record = {**json.loads((run / PLAN).read_text())}
    policy.save_pretrained(tmp_path / "run")
    before = contents(tmp_path)
    with pytest.raises(SystemExit):
        main([command, "--run", str(tmp_path / "run")])
    assert "the weights of clip-rn50 are not on this machine" in capsys.readouterr().err
    assert contents(tmp_path) == before


def test_another_encoder_than_the_runs_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"trained with the text encoder 'hashing' and cannot read by 'minilm'"):
        GraspPolicy.from_pretrained(run, text_encoder="minilm")
    build(replace(SMALL["dense"], text_encoder="clip-rn50:/elsewhere/a.safetensors")).save_pretrained(tmp_path)
    loaded = GraspPolicy.from_pretrained(tmp_path, text_encoder="clip-rn50:b.safetensors")
    assert loaded.text_encoder == "clip-rn50:b.safetensors"


def test_sharing_over_something_is_refused(run: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LOG).write_text("mine")
    with pytest.raises(InputError, match="is no empty folder"):
        sharing_of(run, tmp_path)
    assert list(contents(tmp_path)) == [f"out/{LOG}"]

"""Weights of a step: what is shared, shown and measured of a run are those that were asked for, and a card says so."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from huggingface_hub import ModelCard
from safetensors.torch import load_file

from equigrasp.artefacts import write_json
from equigrasp.cli import main
from equigrasp.cli.common import make_env
from equigrasp.collection import SEEDS_PER_RUN
from equigrasp.config import ModelConfig
from equigrasp.errors import InputError
from equigrasp.evaluation import scene_at, scene_seed
from equigrasp.models import MODELS
from equigrasp.plan import TESTS, WEIGHTS, Training, check_model, kept_weights, read_plan
from equigrasp.policy import GraspPolicy
from equigrasp.sharing.measured import read_evaluations
from equigrasp.study.matrix import Job, Protocol
from equigrasp.study.work import Work
from equigrasp.success import Rate
from equigrasp.training import load_policy, train
from tasks import TASKS

OF_STEP = ["--step", "50"]
EVALUATE = ["evaluate", "--protocol", "single-shot", "--scenes", "2", "--threads", "1", "--run"]


def small() -> ModelConfig:
    return replace(MODELS["fcgq"], widths=(8, 8, 16, 16, 16), text_encoder="hashing")  # type: ignore[call-arg]


def not_asked(*_: Any) -> dict[str, Any]:
    """How equivariant a policy is, where no scene is turned."""
    raise AssertionError("something was turned")


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory, data: Path) -> Path:
    """A run of a study that chose the weights of step 50 of 60, with its tests of them, and an evaluation of the last.

    The choice is written beforehand, as a study that goes on finds it.
    """
    folder = tmp_path_factory.mktemp("steps")
    protocol = Protocol(scenes=1, queries=2, validation=1, turned=0)
    job = Job(small(), "pick-by-part", 1, 0, 60, 0.0, "overhead", 1, 2, protocol, ("pick-by-part",))
    shutil.copytree(data, folder / job.data)
    run = folder / job.run
    run.parent.mkdir()
    goals = {"pick-by-part": len(TASKS["pick-by-part"].goals)}
    work = Work(folder, make_env, goals, not_asked)
    work._train(job, folder / job.data, run)
    write_json(run / "choice-1-of-2.json", {"checkpoint": 50, "validation_successes": {"50": 1, "60": 0}})
    (line,) = work(job)
    assert line["checkpoint"] == 50
    main([*EVALUATE, str(run)])
    return run


@pytest.fixture
def run(studied: Path, tmp_path: Path) -> Path:
    """A copy of it that a test may change."""
    return Path(shutil.copytree(studied, tmp_path / "run"))


def card(run: Path, out: Path, *options: str) -> str:
    main(["share", "--run", str(run), "--out", str(out), *options])
    return ModelCard.load(out / "README.md").text


def rows(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("| pick-by-part |")]


def test_the_weights_of_a_step_are_shared_and_say_which_they_are(run: Path, tmp_path: Path) -> None:
    text = card(run, tmp_path / "out", *OF_STEP)
    for folder, name in ((run, kept_weights(50)), (tmp_path / "out", WEIGHTS)):
        tensors = load_file(folder / name)
        assert all(torch.equal(value, tensors[key]) for key, value in load_policy(run, 50).state_dict().items())
    assert "| Training steps | 60 |" in text
    assert "| Weights | of step 50 of these |" in text
    assert "| Weights |" not in card(run, tmp_path / "last")
    # whoever goes on from the folder takes them for no last ones
    assert GraspPolicy.from_pretrained(tmp_path / "out").record["step"] == 50
    main([*EVALUATE, str(tmp_path / "out"), "--no-oracle"])
    (path,) = (tmp_path / "out" / "evaluations").glob("*.json")
    assert json.loads(path.read_text())["step"] == 50
    again = card(tmp_path / "out", tmp_path / "again")
    assert "| Weights | of step 50 of these |" in again
    assert len(rows(again)) == 1


def test_no_training_goes_on_in_a_folder_that_was_shared_of_a_step(
    run: Path, tmp_path: Path, data: Path, demonstrations: Any
) -> None:
    card(run, tmp_path / "out", *OF_STEP)
    check_model(tmp_path / "out", small())
    training = Training(**read_plan(run)["training"])
    with pytest.raises(InputError, match="was begun with step 50"):
        train(small(), training, demonstrations, data, tmp_path / "out")


def test_a_card_has_what_was_measured_of_its_own_step(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    last = card(run, tmp_path / "last")
    assert "the weights of step 50 were measured, too; --step 50 shares them" in capsys.readouterr().out
    (evaluated,) = (run / "evaluations").glob("*.json")
    assert len(rows(last)) == 1
    rate = json.loads(evaluated.read_text())["policy"]["rates"]["correct"]
    assert str(Rate(rate["successes"], rate["trials"])) in rows(last)[0]
    # a study's tests are measurements like any other: no `evaluate` was asked about step 50
    of_step = rows(card(run, tmp_path / "of-step", *OF_STEP))
    said = capsys.readouterr().out
    assert "was not measured; `equigrasp evaluate" not in said
    assert "the weights of step 60 were measured, too; without --step they are shared" in said
    (test,) = (run / TESTS).glob("*.json")
    values = json.loads(test.read_text())
    assert len(of_step) == 2
    assert "one grasp in each of 2 unseen scenes" in of_step[0]
    assert "n + 1 trials for n goals in each of 1 unseen scenes" in of_step[1]
    for row, key in zip(of_step, ("single_shot", "paper"), strict=True):
        rate = values[key]["rates"]["correct"]
        assert str(Rate(rate["successes"], rate["trials"])) in row
        assert row.endswith("| not measured |")


def test_an_evaluation_stands_once_on_a_card_whoever_made_it_under_whichever_name(run: Path, tmp_path: Path) -> None:
    plan = read_plan(run)
    before = read_evaluations(run, plan)
    (last,) = (run / "evaluations").glob("*step-last.json")
    shutil.copy(last, last.with_name(last.name.replace("step-last", "step-60")))
    assert read_evaluations(run, plan) == before
    main([*EVALUATE, str(run), *OF_STEP])  # what the study asked, with the oracle beside it
    after = read_evaluations(run, plan)
    assert len(after) == len(before)
    assert [each.oracle is None for each in after if each.protocol == "single-shot"] == [False, False]
    main([*EVALUATE, str(run), *OF_STEP, "--phrasings", "unseen"])
    assert len(read_evaluations(run, plan)) == len(before) + 1


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [({"data": "0"}, "is not an evaluation of this run"), ({"seed": None}, "is damaged"), (None, "is damaged")],
    ids=str,
)
def test_another_runs_test_is_refused(changes: dict | None, sentence: str, run: Path) -> None:
    (path,) = (run / TESTS).glob("*.json")
    values = json.loads(path.read_text())
    if changes is None:
        values["line"] = 3
    else:
        line = values["line"] | changes
        values["line"] = {key: value for key, value in line.items() if value is not None}
    path.write_text(json.dumps(values))
    with pytest.raises(InputError, match=sentence):
        read_evaluations(run, read_plan(run))


def test_laws_are_on_the_card_of_the_weights_that_they_were_measured_of(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    law = {"law": "fourier", "subject": "kernel", "status": "holds", "reason": None, "verdict": None}
    asked: list[GraspPolicy] = []

    def stop(policy: GraspPolicy, **_: Any) -> None:
        asked.append(policy)
        raise InputError("enough")

    monkeypatch.setattr("equivariance_tests.check.check_equivariance", stop)
    with pytest.raises(SystemExit):
        main(["equivariance", "--run", str(run), *OF_STEP])
    (policy,) = asked
    assert all(torch.equal(value, load_file(run / kept_weights(50))[key]) for key, value in policy.state_dict().items())
    with pytest.raises(SystemExit):
        main(["equivariance", "--policy", "my_policy:make", *OF_STEP])
    assert "--step is 50, but only a --run has weights of steps" in capsys.readouterr().err
    report = {"report": {"laws": [law]}, "run": read_plan(run), "step": 50}
    (run / "equivariance-step-50").mkdir()
    write_json(run / "equivariance-step-50" / "equivariance.json", report)
    assert "| fourier | kernel |" in card(run, tmp_path / "of-step", *OF_STEP)
    assert "| fourier | kernel |" not in card(run, tmp_path / "last")
    path = str(run / "equivariance-step-50" / "equivariance.json")
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["share", "--run", str(run), "--out", str(tmp_path / "none"), "--equivariance", path])
    assert "is of the weights of step 50, but those of step 60 are shared" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_a_step_that_was_not_kept_is_said_in_the_same_words_by_all(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = set()
    for command in ("evaluate", "export", "share", "show", "equivariance"):
        out = ["--out", str(tmp_path / "new.onnx")] if command in ("export", "share") else []
        with pytest.raises(SystemExit) as stopped:
            main([command, "--run", str(run), "--step", "7", *out])
        assert stopped.value.code == 2
        said.add(capsys.readouterr().err)
    (sentence,) = said
    assert f"has no weights {kept_weights(7)}; it has {kept_weights(50)}, {WEIGHTS}" in sentence
    assert not (tmp_path / "new.onnx").exists()


def test_what_is_shown_is_what_an_evaluation_counted(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same scene, sentence and outcome, of the weights that were asked; never a demonstration's scene."""
    (path,) = (run / TESTS).glob("*.json")
    trials = json.loads(path.read_text())["single_shot"]["trials"]
    for place, trial in enumerate(trials):
        options = ["--seed", str(place), "--goal", str(trial["goal"])]
        main(["show", "--run", str(run), *OF_STEP, *options])
        said, picture, following = capsys.readouterr().out.splitlines()
        assert said.startswith(f"“{trial['instruction']}”: ")
        lifted = " and ".join(trial["lifted"])
        assert said.partition("”: ")[2].startswith(f"lifted the {lifted}" if lifted else "nothing lifted")
        assert picture.endswith(f"pick-by-part-seed{place}-step-50.png")
        assert f" --step 50 --goal {trial['goal']} --seed {place + 1}" in following


def test_every_test_scene_can_be_shown_and_no_other(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed, index in ((0, 0), (0, 499), (7, 3), (999, SEEDS_PER_RUN - 1)):
        assert scene_at(seed * 10**6 + index) == scene_seed(seed, index) >= 1000 * SEEDS_PER_RUN
    for seed in (-1, 10**9, scene_seed(0, 3)):
        with pytest.raises(SystemExit):
            main(["show", "--run", str(run), "--seed", str(seed)])
        (sentence,) = capsys.readouterr().err.splitlines()
        assert f"--seed is {seed}, but it must be from 0 to 999999999; " in sentence

"""What is wrong in arguments, folders and files is one sentence, said before any work, and its way out leads out."""

from __future__ import annotations

import errno
import json
import os
import shlex
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from folders import contents

from equigrasp import clip, language
from equigrasp.cli import main
from equigrasp.clip import check_file
from equigrasp.collection import Collection, draw_goals
from equigrasp.errors import InputError
from equigrasp.models import MODELS
from equigrasp.plan import WEIGHTS, kept_weights
from equigrasp.study.settings import config
from equigrasp.training import CHECKPOINT, LOG
from equigrasp.training.loop import rewind_log
from tasks import TASKS

TRAIN = ["train", "--steps", "2", "--threads", "1", "--text-encoder", "hashing"]
EVALUATE = ["evaluate", "--protocol", "single-shot", "--scenes", "2", "--no-oracle", "--threads", "1"]
STUDY = ["study", "--models", "leg-unet", "--tasks", "pick-logo", "--steps", "6", "--seeds", "0", "--demos", "1"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory, data: Path) -> Path:
    """A run of two steps."""
    out = tmp_path_factory.mktemp("inputs") / "run"
    main([*TRAIN, "--data", str(data), "--out", str(out)])
    return out


@pytest.fixture
def run(trained: Path, tmp_path: Path) -> Path:
    """The same run, for a test to damage."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command that must be refused in one sentence, nothing written and nothing begun; gives the sentence."""

    def begun(*_: Any, **__: Any) -> None:
        pytest.fail("work was begun")

    def refuse(*arguments: object) -> str:
        before = contents(tmp_path)
        with monkeypatch.context() as patch:
            patch.chdir(tmp_path)
            for module in ("policy", "study", "suite", "pictures"):
                patch.setattr(f"equigrasp.cli.{module}.make_env", begun)
            patch.setattr("equigrasp.models.build", begun)
            patch.setattr("equigrasp.training.train", begun)
            patch.setattr("equigrasp.training.load_policy", begun)
            with pytest.raises(SystemExit) as stopped:
                main([str(each) for each in arguments])
        assert stopped.value.code == 2
        assert contents(tmp_path) == before
        said = capsys.readouterr()
        assert "next:" not in said.out
        (sentence,) = said.err.splitlines()
        return sentence

    return refuse


def edit(path: Path, **changes: Any) -> None:
    """Set values of a JSON file; None takes one out."""
    values = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not None}))


@pytest.mark.parametrize(
    ("command", "options", "sentence"),
    [
        (["train"], ["--text-encoder", "clip-rn50:random"], "a clip-rn50 of random weights reads no instruction"),
        (["train"], ["--text-encoder", ""], "there is no text encoder ''"),
        (["train"], ["--threads", "0"], "--threads is 0, but it must be from 1 to 1024"),
        (STUDY, ["--text-encoder", "clip-rn50:nope.safetensors"], "'nope.safetensors' is not one on this machine"),
        (STUDY, ["--text-encoder", "clip-rn50:random"], "a clip-rn50 of random weights reads no instruction"),
    ],
    ids=str,
)
def test_an_option_of_train_or_study_that_cannot_be(
    command: list[str], options: list[str], sentence: str, data: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    if command == ["train"]:
        assert sentence in refused(*command, "--data", data, *options, "--out", tmp_path / "out")
    else:
        for dry in ([], ["--dry-run"]):
            assert sentence in refused(*command, *options, *dry, "--out", tmp_path / "out")


def test_a_model_on_random_clip_that_would_read_by_it_is_not_promised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = ["study", "--table", "1", "--models", "cliport-rn50", "--clip-weights", "random", "--dry-run"]
    with pytest.raises(SystemExit):
        main([*study, "--out", str(tmp_path / "out")])
    assert "not run: cliport-rn50, a clip-rn50 of random weights reads no instruction" in capsys.readouterr().out
    main([*study, "--text-encoder", "hashing", "--out", str(tmp_path / "out")])
    assert "42 cells" in capsys.readouterr().out


def test_the_home_folder_in_the_name_of_weights_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "rn50.safetensors").write_bytes(b"weights")
    there, by_home = (
        config(replace(MODELS["leg-unet"], text_encoder=f"clip-rn50:{folder}/rn50.safetensors"))
        for folder in (tmp_path, "~")
    )
    assert there == by_home
    assert there["text_encoder"].startswith("clip-rn50:sha256:")
    with pytest.raises(InputError, match="is not one on this machine"):
        language.check_encoder(f"clip-rn50:{tmp_path}/none.safetensors")
    with pytest.raises(InputError, match="is not one on this machine"):
        config(replace(MODELS["leg-unet"], text_encoder="clip-rn50:none.safetensors"))
    assert clip.find_file("clip-rn50", "~/rn50.safetensors") == tmp_path / "rn50.safetensors"


@pytest.mark.parametrize("option", ["--demos", "--seeds", "--steps", "--recombination"])
def test_a_study_of_nothing_is_refused(option: str, refused: Callable[..., str]) -> None:
    assert f"{option} has no number" in refused("study", "--table", "6", option, "--dry-run")


@pytest.mark.parametrize("table", [[], ["--table", "5", "--models", "leg-unet"]], ids=str)
def test_a_dry_run_refuses_the_folders_that_the_run_refuses(
    table: list[str], tmp_path: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["study", *table, "--dry-run"] if table else [*STUDY, "--dry-run"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    assert "holds other things (thesis.tex" in refused(*command, "--out", tmp_path / "mine")
    assert "is a file, not a folder" in refused(*command, "--out", tmp_path / "mine" / "thesis.tex")
    # what a killed study leaves of a folder is no matter
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / ".partial-study.json").write_text("{")
    before = contents(tmp_path)
    main([*command, "--out", str(tmp_path / "begun")])
    main([*command, "--out", str(tmp_path / "new" / "one")])
    assert "missing" in capsys.readouterr().out
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--threads", "0"], "--threads is 0, but it must be from 1 to 1024"),
        (["--threads", "3000000000"], "--threads is 3000000000, but it must be from 1 to 1024"),
        (["--failures", "-1"], "--failures is -1, but it must be at least 0"),
        (["--scenes", "0"], "--scenes is 0"),
        (["--seed", "1000"], "--seed is 1000"),
        (["--task", ""], "there is no task ''"),
        (["--failures", "1", "--out", "taken.json"], "taken-failures is a file, not a folder"),
    ],
    ids=str,
)
def test_an_option_of_evaluate_that_cannot_be(
    options: list[str], sentence: str, run: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    (tmp_path / "taken-failures").write_text("mine")
    assert sentence in refused(*EVALUATE[:3], "--run", run, *options)


def test_the_place_of_evaluations_is_looked_at_first(run: Path, refused: Callable[..., str]) -> None:
    (run / "evaluations").write_text("mine")
    assert "evaluations is a file, not a folder; choose another --out" in refused(*EVALUATE, "--run", run)


def test_failures_are_drawn_beside_a_file_without_suffix(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spaced = run.rename(tmp_path / "d é ü")
    main([*EVALUATE, "--run", str(spaced), "--failures", "1", "--out", str(tmp_path / "evaluation")])
    assert json.loads((tmp_path / "evaluation").read_text())["protocol"] == "single-shot"
    assert (tmp_path / "evaluation-failures" / "1.png").read_bytes().startswith(b"\x89PNG")
    assert f"next: equigrasp show --run '{spaced}' --seed 3" in capsys.readouterr().out


def next_of(said: str) -> list[str]:
    """The command that the last line says comes next, as a shell would split it."""
    first, last = shlex.split(said.splitlines()[-1])[:2], shlex.split(said.splitlines()[-1])[2:]
    assert first == ["next:", "equigrasp"]
    return last


def test_what_comes_next_is_of_the_same_task_goal_and_camera(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same = ["--run", str(run), "--task", "pick-logo", "--camera", "fused"]
    main([*EVALUATE, *same, "--out", str(tmp_path / "evaluation")])
    shown = next_of(capsys.readouterr().out)
    assert shown == ["show", *same[:2], *same[2:], "--seed", "3"]
    asked = ["--goal", "2", "--instruction", "pick up the block with the moon's logo"]
    picture = ["--out", str(tmp_path / "picture.png")]
    main([*shown, *asked, *picture])
    again = next_of(capsys.readouterr().out)
    assert again == ["show", *same[:4], *asked, *same[4:], "--seed", "4"]
    main([*again, *picture])
    main(["show", "--run", str(run), *picture])
    assert next_of(capsys.readouterr().out) == ["show", "--run", str(run), "--seed", "4"]


@pytest.mark.parametrize(
    ("options", "task"),
    [
        ([], "pick-by-part"),
        (["--task", "pick-fruit"], "pick-fruit"),
        (["--task", "pick-novel-v2"], "pick-by-part"),  # of which nothing is collected
    ],
    ids=str,
)
def test_what_comes_after_a_list_of_goals_collects_them(
    options: list[str], task: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["tasks", *options])
    assert next_of(capsys.readouterr().out) == ["collect", "--task", task, "--demos", "1"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"training": [1]}, "training is [1]"),
        ({"training": {"steps": "2"}}, "training is {'steps': '2'}"),
        ({"model": 3}, "model is 3"),
        ({"model": None}, "model is missing"),
        ({"task": ["pick-by-part"]}, "task is ['pick-by-part']"),
        ({"camera": [1]}, "camera is [1]"),
    ],
    ids=str,
)
def test_a_damaged_plan_is_one_sentence(
    changes: dict[str, Any], said: str, run: Path, data: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    edit(run / "config.json", **changes)
    expected = f"{run / 'config.json'} is damaged, or no training's: {said}; train again into another folder"
    assert expected in refused(*EVALUATE, "--run", run)
    assert expected in refused("share", "--run", run, "--out", tmp_path / "shared")
    assert expected in refused(*TRAIN, "--data", data, "--out", run)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"heightmap": 5}, "heightmaps of 5 pixels"),
        ({"camera": None}, "manifest.json is damaged: camera is missing"),
        ({"demos": None}, "manifest.json is damaged: demos is missing"),
        ({"seed": "0"}, "manifest.json is damaged: seed is '0'"),
        ({"task": 7}, "manifest.json is damaged: task is 7"),
    ],
    ids=str,
)
def test_a_damaged_manifest_is_one_sentence(
    changes: dict[str, Any], said: str, data: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    copy = Path(shutil.copytree(data, tmp_path / "data"))
    edit(copy / "manifest.json", **changes)
    sentence = refused(*TRAIN, "--data", copy, "--out", tmp_path / "out")
    assert said in sentence
    assert "collect it again into an empty folder" in sentence


@pytest.mark.parametrize("content", [b"garbage", b""], ids=["garbage", "empty"])
def test_the_way_out_of_damaged_weights_leads_out(
    content: bytes, run: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = (run / WEIGHTS).read_bytes()
    (run / WEIGHTS).write_bytes(content)
    again = [*TRAIN, "--data", str(data), "--out", str(run)]
    with pytest.raises(SystemExit):
        main(again)
    said = capsys.readouterr().err
    assert f"{run / WEIGHTS} is damaged or another model's" in said
    assert "delete this file and run its `equigrasp train` again, which makes it from the checkpoint" in said
    (run / WEIGHTS).unlink()
    main(again)
    assert (run / WEIGHTS).read_bytes() == whole


@pytest.fixture
def locked(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Takes the right to read one file; root, who may run the tests, would keep it whatever the file's mode."""
    opened = Path.open

    def lock(path: Path) -> None:
        def open_unless_locked(self: Path, *arguments: Any, **options: Any) -> Any:
            if self == path:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
            return opened(self, *arguments, **options)

        monkeypatch.setattr(Path, "open", open_unless_locked)

    return lock


def test_weights_that_may_not_be_read_are_not_called_damaged(
    run: Path, locked: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    locked(run / WEIGHTS)
    with pytest.raises(SystemExit) as stopped:
        main([*EVALUATE, "--run", str(run)])
    assert stopped.value.code == 2
    sentence = f"{run / WEIGHTS} cannot be read (Permission denied); ask its owner, or change its mode"
    assert capsys.readouterr().err == f"equigrasp: {sentence}\n"


def test_clip_that_may_not_be_read_is_not_called_damaged(run: Path, locked: Callable[[Path], None]) -> None:
    locked(run / WEIGHTS)
    with pytest.raises(InputError, match=r"cannot be read \(Permission denied\)"):
        check_file("clip-rn50", run / WEIGHTS)


def test_damaged_weights_of_a_step_have_their_own_way_out(run: Path, refused: Callable[..., str]) -> None:
    (run / kept_weights(1)).write_bytes(b"garbage")
    assert "take another --step" in refused(*EVALUATE, "--run", run, "--step", "1")


@pytest.mark.parametrize("broken", [b"[1]\n", b'{"step": "50"}\n', b"\xff\xfe\x00\n", b"5\n"], ids=str)
def test_a_damaged_log_is_dropped_from_there(broken: bytes, tmp_path: Path) -> None:
    good = b'{"step": 50, "loss": 1.5}\n'
    log = tmp_path / LOG
    log.write_bytes(good + broken + b'{"step": 100, "loss": 1.0}\n')
    rewind_log(log, 200)
    assert log.read_bytes() == good
    log.write_bytes(broken)
    rewind_log(log, 200)
    assert log.read_bytes() == b""


def test_a_training_goes_on_over_a_damaged_log(run: Path, data: Path) -> None:
    (run / WEIGHTS).unlink()
    assert (run / CHECKPOINT).exists()
    (run / LOG).write_bytes(b"[1]\n\xff\xfe")
    main([*TRAIN, "--data", str(data), "--out", str(run)])
    assert (run / LOG).read_bytes() == b""


def test_more_grasps_than_scenes_are_refused_soon(tmp_path: Path, refused: Callable[..., str]) -> None:
    drawn = 0

    def count(_: Any) -> tuple[int, ...]:
        nonlocal drawn
        drawn += 1
        return tuple(range(23))

    with pytest.raises(InputError, match=r"a seed has scenes for 100000 grasps, .* ask for at most 4347"):
        draw_goals(count, 99_999, seed=0)
    assert drawn == 4348
    assert "ask for at most 4347" in refused("collect", "--demos", 99_999, "--out", tmp_path / "out")
    most = draw_goals(TASKS["pick-by-part"].demonstration_goals, 4347, seed=0)
    assert Collection("pick-by-part", most, 0, "fused").demos == 4347


@pytest.mark.parametrize(
    "arguments", [["evaluate", "--run"], ["train", "--data"], ["share", "--out", "shared", "--run"]], ids=str
)
def test_commands_in_sentences_can_be_pasted(arguments: list[str], tmp_path: Path, refused: Callable[..., str]) -> None:
    nothing = tmp_path / "d é ü; rm x"
    _, command, _ = refused(*arguments, nothing).split("`")
    assert shlex.split(command)[-2:] == ["--out", str(nothing)]

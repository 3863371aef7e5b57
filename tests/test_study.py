"""A study ends with the same results whoever made them: killed, resumed, by one worker or two."""

from __future__ import annotations

import json
import os
import random
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshes
import pytest

from equigrasp.artefacts import LOCK, alone
from equigrasp.cli.study import Study
from equigrasp.collection import SEEDS_PER_RUN
from equigrasp.errors import InputError
from equigrasp.evaluation import FIRST_SEED, SCENES_PER_SEED, VALIDATION_SEED, scene_seed
from equigrasp.models import MODELS, find
from equigrasp.plan import WEIGHTS
from equigrasp.study import results
from equigrasp.study.estimate import seconds, spoken
from equigrasp.study.matrix import Job, Matrix, Protocol
from equigrasp.study.results import known_by, read, recover, without_circumstances
from equigrasp.study.tables import TABLES, TESTED_ON
from tasks import TASKS, difficulty
from tasks.instructions import GRAMMARS

DOCS = Path(__file__).parent.parent / "docs"
KILLS = int(os.environ.get("EQUIGRASP_KILLS", "2"))
"""SIGKILLs of the study; more for a thorough run."""
SMALL = Study(
    models=("leg-steerable",),
    tasks=("pick-logo",),
    tested_on=("pick-logo", "pick-fruit"),
    demos=(1,),
    seeds=(0,),
    steps=(6,),
    recombination=(0.0, 0.7),
    scenes=1,
    queries=4,
    turned=2,
    camera="overhead",
    text_encoder="hashing",
)
ARGUMENTS = """study --models leg-steerable --tasks pick-logo --tested-on pick-logo pick-fruit --demos 1 --seeds 0
--steps 6 --recombination 0 0.7 --scenes 1 --queries 4 --turned 2 --camera overhead --text-encoder hashing"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that nobody disturbed."""
    return replace(SMALL, out=tmp_path_factory.mktemp("study") / "out").execute()


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    """The same study's results in a folder that a test may change."""
    # every file but the results is only ever replaced, never written into
    shutil.copytree(finished.parent, tmp_path / "copy", copy_function=os.link)
    path = tmp_path / "copy" / finished.name
    path.unlink()
    return Path(shutil.copy(finished, path))


def collected(finished: Path, out: Path) -> None:
    """A study that got as far as its demonstrations."""
    shutil.copytree(finished.parent / "data", out / "data")
    shutil.copy(finished.parent / "study.json", out)


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def found_of(found: list[dict[str, Any]], recombination: float, task: str) -> dict[str, Any]:
    (line,) = (each for each in found if (each["recombination"], each["tested_on"]) == (recombination, task))
    return line["equivariance"]


def in_any_order(path: Path) -> list[str]:
    return sorted(json.dumps(line, sort_keys=True) for line in without_circumstances(lines(path)))


def test_a_line_says_what_was_done(finished: Path) -> None:
    found = lines(finished)
    assert [(line["recombination"], line["tested_on"]) for line in found] == [
        (0.0, "pick-logo"),
        (0.0, "pick-fruit"),
        (0.7, "pick-logo"),
        (0.7, "pick-fruit"),
    ]
    for line in found:
        measured = line["equivariance"]
        assert line["model"] == "leg-steerable"
        assert (line["trained_on"], line["demos"], line["steps"]) == ("pick-logo", 1, 6)
        shots, paper = line["single_shot"], line["paper"]
        assert shots["grasped"]["trials"] == 4
        assert shots["grasped"]["successes"] >= shots["correct_object"]["successes"] >= shots["correct"]["successes"]
        assert sum(shots["failures"].values()) == 4 - shots["correct"]["successes"]
        assert measured["turned"]["scenes"] + measured["turned"]["crowded"] == 2
        assert 0 < measured["kernel"] < 1e-3 < measured["scores"]
        assert paper["scenes"] == 1
        assert 0 <= paper["reward"] <= 1
        assert line["clip_pretrained"] is None
        assert line["versions"]["torch"]
        assert line["trained_with"] == [{name: line[name] for name in ("versions", "git", "device")}]
        assert line["seconds"]["train_steps"] == 6
    # one collection for both trainings, and one training and one look at its symmetry for both of its tests
    assert found_of(found, 0.0, "pick-logo") == found_of(found, 0.0, "pick-fruit") != found_of(found, 0.7, "pick-logo")
    assert len(list((finished.parent / "runs").iterdir())) == 2
    assert len(list((finished.parent / "data").iterdir())) == 1


def test_a_line_says_by_what_its_training_was_begun_and_went_on(tmp_path: Path, finished: Path) -> None:
    """As of a study that was killed, and goes on after an update."""
    collected(finished, tmp_path / "out")
    before = {"versions": {"torch": "1.0"}, "git": None, "device": {"kind": "cpu"}}
    names = [path.name for path in (finished.parent / "runs").iterdir()]
    (tmp_path / "out" / "starts").mkdir()
    for name in names:
        (tmp_path / "out" / "starts" / f"{name}.json").write_text(json.dumps({"starts": [before]}))
    for line in lines(replace(SMALL, out=tmp_path / "out").execute()):
        first, last = line["trained_with"]
        assert first == before
        assert last["versions"] == line["versions"]


def test_a_study_killed_at_random_ends_with_the_same_results(tmp_path: Path, finished: Path) -> None:
    """SIGKILL of the real process, at moments that fall into training, testing, writing and, if many, collecting."""
    out = tmp_path / "out"
    if KILLS <= 2:
        collected(finished, out)
    command = [sys.executable, "-m", "equigrasp", *ARGUMENTS.split(), "--out", str(out)]
    moments = random.Random(5)
    for _ in range(KILLS):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seen = set(out.rglob("*"))
        # not before it has written something more, or a slow start would take every shot
        while set(out.rglob("*")) == seen and process.poll() is None:
            time.sleep(0.01)
        time.sleep(moments.uniform(0, 5))
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert read(out / results.RESULTS)[1] == ""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert without_circumstances(lines(out / results.RESULTS)) == without_circumstances(lines(finished))


def test_two_workers_give_the_lines_of_one(tmp_path: Path, finished: Path) -> None:
    # collecting with several workers has a law of its own
    collected(finished, tmp_path / "out")
    again = replace(SMALL, workers=2, out=tmp_path / "out").execute()
    assert in_any_order(again) == in_any_order(finished)


def test_a_finished_study_does_nothing_again(copied: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in copied.parent.rglob("*") if path.name != LOCK}
    replace(SMALL, out=copied.parent).execute()
    after = {path: path.stat().st_mtime_ns for path in copied.parent.rglob("*") if path.name != LOCK}
    assert after == before


def test_what_comes_after_a_study_draws_its_table_beside_it(
    copied: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a task that no table of the paper's has, and not over the tables that ship."""
    replace(SMALL, out=copied.parent).execute()
    *_, script, _, results, _, out = shlex.split(capsys.readouterr().out.splitlines()[-1])
    assert (results, out) == (str(copied), str(copied.parent))
    monkeypatch.setattr(sys, "argv", [script, "--results", results, "--out", out])
    runpy.run_path(str(DOCS.parent / script), run_name="__main__")
    page = (copied.parent / "table-own.md").read_text()
    assert "trained on pick-logo" in page
    assert "| pick-logo | pick-fruit |" in page


def test_a_dry_run_bakes_nothing_and_knows_the_same_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = meshes.write_hammer(tmp_path)
    (tmp_path / "meshes_of_mine.py").write_text(
        "from tasks import Goal, Task\nfrom tasks.meshes import MeshObject\n"
        f"HAMMER = MeshObject('toy-hammer', {str(file)!r}, scale=0.001)\n"
        "MINE = Task('mine', 'mine/Mine-v0', (Goal('toy-hammer'), Goal('fork')), objects=(2, 2), own=(HAMMER,))\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("EQUIGRASP_CACHE", str(tmp_path / "cache"))
    study = replace(SMALL, tasks=("meshes_of_mine:MINE",), tested_on=(), recombination=(0.0,), out=tmp_path / "out")
    dry = replace(study, dry_run=True)
    dry.execute()
    assert "1 cells: 0 done, 1 missing" in capsys.readouterr().out
    assert not (tmp_path / "cache" / "objects").exists()
    before = dry._matrix([MODELS["vit"]])
    assert study._matrix([MODELS["vit"]]) == before
    assert (tmp_path / "cache" / "objects").exists()
    monkeypatch.delitem(sys.modules, "meshes_of_mine")


def test_a_finer_read_out_is_another_model(copied: Path) -> None:
    before = copied.read_bytes()
    finer = replace(SMALL, recombination=(0.0,), tested_on=("pick-logo",), read_out="full", out=copied.parent)
    after = finer.execute().read_bytes()
    assert after.startswith(before)
    (line,) = (json.loads(each) for each in after[len(before) :].splitlines())
    assert line["config"]["stride"] == 1
    assert {each["config"]["stride"] for each in lines(copied)[:-1]} == {2}
    assert found_of(lines(copied)[:-1], 0.0, "pick-logo")["turned"] != line["equivariance"]["turned"]


def test_half_a_line_is_dropped_and_its_cell_comes_back(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = copied.read_bytes()
    for end in (len(whole) - 200, len(whole) - 1):
        copied.write_bytes(whole[:end])
        replace(SMALL, out=copied.parent).execute()
        assert copied.read_bytes() == whole
    assert capsys.readouterr().out.count("was not whole") == 1


def test_a_study_that_does_not_mend_its_file_would_be_noticed(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The law above fails for a study that appends to half a line: two cells become none."""
    monkeypatch.setattr(results, "recover", results.read)
    whole = copied.read_bytes()
    copied.write_bytes(whole[:-200])
    replace(SMALL, out=copied.parent).execute()
    assert copied.read_bytes() != whole
    with pytest.raises(InputError, match="line 4 of"):
        read(copied)


def test_a_lost_test_is_made_again_to_the_same_result(copied: Path) -> None:
    """What comes back after a loss is the measurement, and not its file alone."""
    before = lines(copied)
    copied.write_text("".join(copied.read_text().splitlines(keepends=True)[:3]))
    (run,) = (path.parent for path in copied.parent.glob("runs/*/config.json") if "0.7" in path.read_text())
    (lost,) = run.glob("tests/pick-fruit-*.json")
    lost.unlink()
    replace(SMALL, out=copied.parent).execute()
    assert without_circumstances(lines(copied)) == without_circumstances(before)


@pytest.mark.parametrize("spoilt", ["{}", "", "[1]", "\u00e9"])
def test_a_damaged_test_is_named_with_its_way_out_and_the_others_are_done(
    copied: Path, spoilt: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = lines(copied)
    copied.unlink()
    (run,) = (path.parent for path in copied.parent.glob("runs/*/config.json") if "0.7" in path.read_text())
    (damaged,) = run.glob("tests/pick-fruit-*.json")
    # not into the file, which another test has too
    damaged.unlink()
    damaged.write_bytes(spoilt.encode("latin-1"))
    with pytest.raises(InputError, match="1 of 2 jobs could not be done"):
        replace(SMALL, out=copied.parent).execute()
    (sentence,) = (line for line in capsys.readouterr().out.splitlines() if "is damaged" in line)
    assert f"{damaged} is damaged: it is not a finished test; delete it, and make it again" in sentence
    assert without_circumstances(lines(copied)) == without_circumstances(before[:2])
    damaged.unlink()
    replace(SMALL, out=copied.parent).execute()
    assert without_circumstances(lines(copied)) == without_circumstances(before)


def test_the_best_checkpoint_is_chosen_on_other_scenes(copied: Path) -> None:
    more = replace(SMALL, recombination=(0.0,), steps=(60,), checkpoints=2, validation=3, scenes=0, queries=1, turned=0)
    replace(more, tested_on=(), out=copied.parent).execute()
    (line,) = (each for each in lines(copied) if each["steps"] == 60)
    scores = line["validation_successes"]
    assert set(scores) == {"50", "60"}
    assert line["checkpoint"] == max((50, 60), key=lambda step: (scores[str(step)], step))
    assert "paper" not in line
    assert "equivariance" not in line


def test_scenes_of_demonstrations_validation_and_tests_never_meet() -> None:
    demonstrations = range(1000 * SEEDS_PER_RUN)
    tests = range(FIRST_SEED, scene_seed(999, SCENES_PER_SEED))
    validation = range(VALIDATION_SEED, scene_seed(999, SCENES_PER_SEED, VALIDATION_SEED))
    for one, other in ((demonstrations, tests), (demonstrations, validation), (tests, validation)):
        assert one.stop <= other.start
    assert tests.stop <= difficulty.FIRST_SEED < validation.start


def test_the_tables_name_what_there_is() -> None:
    for table in TABLES.values():
        assert set(table.models) <= set(MODELS)
        assert all(TASKS[task].trains for task in table.tasks)
    for task, tests in TESTED_ON.items():
        assert TASKS[task].trains
        assert set(tests) <= set(TASKS)


def matrix(**changes: Any) -> Matrix:
    whole = Matrix((MODELS["leg-unet"],), ("pick-random-v2", "pick-by-part"), (1, 10), (0, 1), (100,))
    return replace(whole, **changes)


def test_trainings_are_shared_and_cells_are_known_by_their_settings() -> None:
    jobs = matrix().jobs()
    assert len(jobs) == len({job.run for job in jobs}) == 8
    assert len({job.data for job in jobs}) == 8
    assert len({job.data for job in matrix(models=(MODELS["leg-unet"], MODELS["fcgq"])).jobs()}) == 8
    assert jobs[0].tests == TESTED_ON["pick-random-v2"]
    cells = [known_by(job.cell(task)) for job in jobs for task in job.tests]
    assert len(set(cells)) == len(cells)
    model = MODELS["leg-unet"]
    (one,) = matrix(tasks=("pick-by-part",), demos=(1,), seeds=(0,)).jobs()

    def known(job: Job) -> str:
        return known_by(job.cell("pick-by-part"))

    assert known(replace(one, model=replace(model, summary="in other words"))) == known(one)
    for other in (
        replace(one, model=replace(model, channels=4)),  # type: ignore[call-arg]
        replace(one, threads=2),
        replace(one, recombination=0.7),
        replace(one, recombination=0.7, hard_negatives=0.5),
        replace(one, recombination=0.7, crowded=0.5),
        replace(one, protocol=Protocol(queries=501)),
        replace(one, device="cuda"),
    ):
        assert known(other) != known(one)
    assert replace(one, device="cuda").run != one.run
    for key in ("training_device", "learning_rate", "hard_negatives", "crowded"):
        assert key not in one.cell("pick-by-part"), "lines from before there was a choice are still known"
    for key in ("hard_negatives", "crowded"):
        other = replace(one, recombination=0.7, **{key: 0.5})
        assert other.run != replace(one, recombination=0.7).run
        assert other.cell("pick-by-part")[key] == 0.5
    vit = MODELS["vit"]
    assert replace(one, model=vit).cell("pick-by-part")["learning_rate"] == vit.learning_rate != model.learning_rate


@pytest.mark.parametrize(
    ("steps", "checkpoints", "candidates"),
    [
        (40_000, 4, [10_000, 20_000, 30_000, 40_000]),
        (1000, 3, [350, 700, 1000]),
        (6, 4, [6]),
        (200, 1, [200]),
        (120, 4, [50, 100, 120]),
    ],
)
def test_candidates(steps: int, checkpoints: int, candidates: list[int]) -> None:
    (job,) = matrix(tasks=("pick-by-part",), demos=(1,), seeds=(0,), steps=(steps,), checkpoints=checkpoints).jobs()
    assert job.candidates == candidates
    assert all(step % 50 == 0 for step in candidates[:-1])


def test_a_line_that_is_there_twice_counts_once(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    cell = {"kind": "grasp", "model": "m"}
    path.write_text("".join(json.dumps({**cell, "date": date, "paper": {}}) + "\n" for date in ("x", "y")))
    assert len(recover(path)[0]) == 1
    assert len(path.read_text().splitlines()) == 1


def test_a_training_whose_folder_is_held_waits(copied: Path, finished: Path) -> None:
    """A machine that was lost lets go of it when its processes are dead."""
    weights = sorted(copied.parent.rglob(WEIGHTS))[0]
    weights.unlink()
    copied.unlink()
    held, released = threading.Event(), threading.Event()

    def hold() -> None:
        with alone(weights.parent, "training"):
            held.set()
            time.sleep(2)
            released.set()

    other = threading.Thread(target=hold)
    other.start()
    held.wait()
    replace(SMALL, out=copied.parent).execute()
    assert released.is_set()
    other.join()
    assert in_any_order(copied) == in_any_order(finished)


def test_a_broken_line_further_up_is_an_error_that_names_it(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    content = '{"kind": "grasp"}\n{"kind": "gra\n{"kind": "cost"}\n'
    path.write_text(content)
    with pytest.raises(InputError, match=r"line 2 of .*results\.jsonl is no JSON object"):
        recover(path)
    assert path.read_text() == content


def test_two_studies_in_a_folder_are_refused(copied: Path) -> None:
    with alone(copied.parent, "study"), pytest.raises(InputError, match="another study is at work"):
        replace(SMALL, out=copied.parent).execute()


def test_a_dry_run_lists_and_writes_nothing(finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace(SMALL, dry_run=True, out=tmp_path / "none").execute()
    assert "4 cells: 0 done, 4 missing, from 2 trainings" in capsys.readouterr().out
    assert not (tmp_path / "none").exists()
    replace(SMALL, recombination=(0.7,), seeds=(0, 7), dry_run=True, out=finished.parent).execute()
    said = capsys.readouterr().out
    assert "seed 0, 6 steps, recombination 0.7: 2 of 2 cells done" in said
    assert "seed 7, 6 steps, recombination 0.7: 0 of 2 cells done; missing: pick-logo, pick-fruit; about " in said


@pytest.fixture
def tiny(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A module of a user's: docs/my_policy.py with two smaller rows more, one of whose losses is no number."""
    path = tmp_path / "tiny_models.py"
    rows = (
        "import dataclasses\nTINY = dataclasses.replace(MY_MODEL, name='tiny', width=8, dilations=(1,))\n"
        "class Broken(FcnConfig):\n    def build(self):\n        policy = super().build()\n"
        "        policy.network.score.bias.data[:] = float('nan')\n        return policy\n"
        "BROKEN = Broken(name='broken', summary='broken', width=8, dilations=(1,))\n"
    )
    path.write_text((DOCS / "my_policy.py").read_text() + rows)
    monkeypatch.syspath_prepend(tmp_path)
    yield path
    sys.modules.pop("tiny_models", None)


def test_a_training_that_fails_does_not_keep_the_others_from_being_done(
    tiny: Path, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    collected(finished, out)
    models = ("tiny_models:BROKEN", "tiny_models:TINY")
    study = replace(SMALL, models=models, tested_on=(), turned=0, recombination=(0.0,), out=out)
    for jobs in (2, 1):
        with pytest.raises(InputError, match=rf"1 of {jobs} jobs could not be done") as error:
            study.execute()
        assert "\n" not in str(error.value)
        said = capsys.readouterr().out
        assert "not done: broken, pick-logo, 1 demos, seed 0, 6 steps: the loss of step 1 is nan" in said
        assert [line["model"] for line in lines(out / results.RESULTS)] == ["tiny"]


def test_an_edited_network_is_another_model(tiny: Path) -> None:
    def cell() -> dict[str, Any]:
        sys.modules.pop("tiny_models", None)
        (job,) = matrix(models=(find("tiny_models:TINY"),), tasks=("pick-logo",), demos=(1,), seeds=(0,)).jobs()
        return {**job.cell("pick-logo"), "run": str(job.run)}

    before = cell()
    assert cell() == before
    tiny.write_text(tiny.read_text().replace("functional.relu(", "3 * functional.relu("))
    after = cell()
    assert known_by(before) != known_by(after)
    assert before["run"] != after["run"]


def test_a_share_of_minus_nothing_is_none() -> None:
    same = matrix(recombination=(0.0, -0.0), tasks=("pick-logo",), demos=(1,), seeds=(0,)).jobs()
    assert len({known_by(job.cell("pick-logo")) for job in same}) == 1
    (job,) = matrix(recombination=(-0.0,), tasks=("pick-logo",), demos=(1,), seeds=(0,)).jobs()
    assert known_by(job.cell("pick-logo")) == known_by(same[0].cell("pick-logo"))


def test_the_estimate_is_what_was_measured() -> None:
    (job,) = matrix(tasks=("pick-by-part",), demos=(1,), seeds=(3,)).jobs()
    took = {"train": 30.0, "train_steps": 100, "single_shot": 50.0, "paper": 200.0, "equivariance": 80.0}
    line = {**job.cell("pick-by-part"), "seconds": took}
    other = replace(job, steps=1000, checkpoints=1, protocol=Protocol(scenes=10, queries=20))
    assert seconds(other, False, 2, [line]) == pytest.approx(1000 * 0.3 + 40 * 0.1 + 20 * 2.0 + 40 * 2.0)
    assert seconds(other, True, 1, [line]) == pytest.approx(20 * 0.1 + 10 * 2.0)
    assert seconds(other, False, 1, []) is None
    # who filters lines may drop what he doesn't need
    untimed = {key: value for key, value in line.items() if key != "seconds"}
    assert seconds(other, True, 1, [untimed]) is None
    assert seconds(other, True, 1, [untimed, line]) == seconds(other, True, 1, [line])
    elsewhere = {**line, "training_device": "cuda"}
    assert seconds(other, True, 1, [elsewhere]) is None
    assert [spoken(value) for value in (40, 720, 12600, 180_000)] == ["40 s", "12 min", "3.5 h", "2.1 days"]


def test_models_on_clip_are_listed_and_not_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = Study(table=1, dry_run=True, seeds=(0,), out=tmp_path / "out")
    study.execute()
    said = capsys.readouterr().out
    for name in ("leg-cliport", "cliport-rn50", "cliport-vit", "cliport-rotator"):
        assert f"not run: {name}, which needs CLIP's weights; --clip-weights names them" in said
    assert "42 cells: 0 done" in said
    # the listing does not promise what the run would refuse
    replace(study, clip_weights=("random",)).execute()
    said = capsys.readouterr().out
    assert "not run: cliport-rn50, a clip-rn50 of random weights reads no instruction" in said
    assert "42 cells: 0 done" in said
    replace(study, clip_weights=("random",), text_encoder="hashing").execute()
    said = capsys.readouterr().out
    assert "not run" not in said
    assert "98 cells: 0 done" in said


def test_what_can_not_be_run_is_no_success(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none of these models can be run"):
        replace(SMALL, models=("cliport-vit",), out=tmp_path / "out").execute()
    for ignored in (
        {"tasks": ("pick-toy",)},
        {"device": "cuda"},
        {"tested_on": ("pick-toy",)},
        {"demos": (7,)},
        {"crowded": 0.4, "recombination": (0.7,)},
        {"clip_weights": ("random",)},
    ):
        options = sorted(f"--{name.replace('_', '-')}" for name in ignored)
        with pytest.raises(InputError, match="trains nothing; leave out") as refused:
            replace(Study(table=5, out=tmp_path / "out"), **ignored).execute()
        assert sorted(str(refused.value).partition("leave out ")[2].split(", ")) == options
    assert not list(tmp_path.iterdir())


def test_no_training_is_split_between_workers(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").mkdir()
    for name in (finished.name, "study.json"):
        shutil.copy(finished.parent / name, tmp_path / "out")
    # another number of steps has no line, and the time of a step is known
    replace(SMALL, steps=(40_000,), recombination=(0.0,), workers=8, dry_run=True, out=tmp_path / "out").execute()
    *_, one, _, total = capsys.readouterr().out.splitlines()
    assert one.rpartition("about ")[2] == total.rpartition("about ")[2].removesuffix(" with --workers 8")


def test_a_row_of_ones_own_that_was_edited_is_another_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = TASKS["pick-toy"]
    edited = (
        replace(task, goals=task.goals[::-1]),
        replace(task, objects=(4, 4)),
        replace(task, repeated=task.repeated + 1),
        replace(task, grammars={"object": replace(GRAMMARS["object"], held_out=GRAMMARS["object"].held_out[1:])}),
    )
    prints = [each.fingerprint() for each in (task, *edited)]
    assert len(set(prints)) == len(prints)
    assert replace(task, summary="said otherwise").fingerprint() == task.fingerprint()
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "rows_of_mine.py").write_text("from tasks import TASKS\nMINE = TASKS['pick-toy']\n")
    study = replace(SMALL, tasks=("rows_of_mine:MINE",), tested_on=(), recombination=(0.0,))
    (job,) = study._matrix([MODELS["vit"]]).jobs()
    assert job.rows == (("rows_of_mine:MINE", task.fingerprint()),)
    other = replace(job, rows=(("rows_of_mine:MINE", edited[0].fingerprint()),))
    assert job.data != other.data
    assert job.run != other.run
    assert known_by(job.cell(job.task)) != known_by(other.cell(job.task))
    assert "row" not in known_by(matrix(tasks=("pick-toy",)).jobs()[0].cell("pick-toy"))


def test_what_is_only_said_about_a_model_changes_nothing() -> None:
    (job,) = matrix(tasks=("pick-toy",), demos=(1,), seeds=(3,)).jobs()
    other = replace(job, model=replace(job.model, summary="said otherwise", paper_parameters=1.0))
    assert (job.cell("pick-toy"), job.run) == (other.cell("pick-toy"), other.run)


def test_costs_are_measured_once(tmp_path: Path) -> None:
    study = Study(table=5, models=("vit", "fcgq"), timed_steps=1, out=tmp_path / "out")
    found = lines(study.execute())
    assert [line["model"] for line in found] == ["vit", "fcgq"]
    for line in found:
        assert line["parameters"] > 1e6
        assert line["seconds"]["step"] > line["seconds"]["read_out"] > 0
        assert line["memory"] > 1e8
    # the smaller one's memory is its own, not what the larger one before it had
    assert found[1]["memory"] < found[0]["memory"]
    assert lines(study.execute()) == found


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"models": ()}, "--table, or --models"),
        ({"models": ("leg-unte",)}, "did you mean 'leg-unet'"),
        ({"tasks": ()}, "--table or --tasks"),
        ({"tasks": ("pick-logos",)}, "did you mean 'pick-logo'"),
        ({"tasks": ("pick-novel-v2",)}, "for testing alone"),
        ({"tested_on": ("pick-frut",)}, "did you mean 'pick-fruit'"),
        ({"demos": (0,)}, "--demos is 0"),
        ({"seeds": (1000,)}, "--seed is 1000"),
        ({"steps": (0,)}, "--steps is 0"),
        ({"checkpoints": 0}, "--checkpoints is 0"),
        ({"validation": 0}, "--validation is 0"),
        ({"turned": -1}, "--turned is -1"),
        ({"recombination": (1.5,)}, "--recombination is 1.5"),
        ({"recombination": (0.7,), "hard_negatives": 1.5}, "--hard-negatives is 1.5"),
        ({"recombination": (0.0,), "hard_negatives": 0.5}, "--hard-negatives is 0.5, but --recombination is 0"),
        ({"recombination": (0.7,), "crowded": -1.0}, "--crowded is -1"),
        ({"recombination": (0.0,), "crowded": 0.5}, "--crowded is 0.5, but --recombination is 0"),
        ({"scenes": 0, "queries": 0}, "both 0"),
        ({"text_encoder": "hash"}, "did you mean 'hashing'"),
        ({"models": ("vit",), "read_out": "full"}, "vit has its own resolution of the read-out"),
        ({"read_out": "quarter"}, "no resolution of a read-out 'quarter'"),
        ({"workers": 0}, "--workers is 0"),
        ({"device": "cuda"}, "no GPU that torch sees"),
        ({"table": 5, "models": ("leg-unet",), "workers": 2}, "side by side"),
    ],
)
def test_a_mistake_is_one_sentence_and_writes_nothing(
    tmp_path: Path, changes: dict, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 0)
    with pytest.raises(InputError, match=sentence) as error:
        replace(SMALL, **changes, out=tmp_path / "out").execute()
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_somebody_elses_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(InputError, match="holds other things"):
        replace(SMALL, out=tmp_path).execute()
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]

"""The command line as a user meets it, in processes of its own: the round trip, mistakes, SIGKILL."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from folders import contents

KILLS = int(os.environ.get("EQUIGRASP_KILLS", "2"))
"""SIGKILLs for each interrupted command; more for a thorough run."""
TRAIN = ["train", "--steps", "100", "--checkpoint-every", "50", "--threads", "1", "--text-encoder", "hashing"]


def equigrasp(*arguments: object, **options) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "equigrasp", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=500, **options)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, data: Path) -> Path:
    """A run trained by the command line."""
    out = tmp_path_factory.mktemp("cli") / "run"
    done = equigrasp(*TRAIN, "--data", data, "--out", out)
    assert done.returncode == 0, done.stderr
    assert f"equigrasp evaluate --run {out}" in done.stdout
    return out


def test_collect_train_evaluate_show(tmp_path: Path, data: Path, run: Path) -> None:
    collected = equigrasp("collect", "--camera", "overhead", "--out", tmp_path / "data")
    assert collected.returncode == 0, collected.stderr
    assert contents(tmp_path / "data") == contents(data)

    out = tmp_path / "evaluation.json"
    evaluated = equigrasp("evaluate", "--run", run, "--protocol", "single-shot", "--scenes", 3, "--out", out)
    assert evaluated.returncode == 0, evaluated.stderr
    assert "by the right part" in evaluated.stdout
    assert "oracle" in evaluated.stdout
    assert out.exists()

    picture = tmp_path / "picture.png"
    shown = equigrasp("show", "--run", run, "--instruction", "lift the fork by its head", "--out", picture)
    assert shown.returncode == 0, shown.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_lists() -> None:
    tasks, goals = equigrasp("tasks"), equigrasp("tasks", "--task", "pick-by-part")
    assert tasks.stdout.count("equigrasp/Pick") == 13
    assert "mug by handle" in goals.stdout


def test_models_are_listed_before_torch_is_there() -> None:
    program = "import sys; from equigrasp.cli import main; main(['models']); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "cliport-vit" in done.stdout
    assert done.stdout.endswith("False\n")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["collect", "--task", "pick-by-prat"], "did you mean 'pick-by-part'"),
        (["collect", "--demos", "0"], "--demos is 0"),
        (["collect", "--out", "{occupied}"], "holds other things"),
        (["collect", "--workers", "0"], "--workers is 0"),
        (["collect", "--engine", "ray", "--address", "127.0.0.1:1"], "no Ray cluster answers"),
        (["export-minari", "--data", "{truncated}"], "truncated or altered"),
        (["train", "--data", "{data}", "--model", "leg-steerible"], "did you mean 'leg-steerable'"),
        (["train", "--data", "{empty}"], "holds no demonstrations"),
        (["train", "--data", "{truncated}"], "truncated or altered"),
        (["train", "--data", "{data}", "--out", "{occupied}"], "holds other things"),
        (["train", "--data", "{data}", "--text-encoder", "minilmm"], "did you mean 'minilm'"),
        (["train", "--data", "{data}", "--text-encoder", "clip-rn50"], "hashing"),
        (["evaluate", "--run", "{empty}"], "is not a run folder"),
        (["evaluate", "--run", "{weightless}"], "no weights"),
        (["evaluate", "--run", "{run}", "--task", "pick-by-prt"], "did you mean 'pick-by-part'"),
        (["evaluate", "--run", "{run}", "--scenes", "0"], "--scenes is 0"),
        (["show", "--run", "{run}", "--instruction", " "], "instruction"),
        (["show", "--run", "{run}", "--instruction", "x" * 10_000], "this has 10000"),
        (["show", "--run", "{run}", "--goal", "23"], "--goal is 23"),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else "",
)
def test_a_mistake_is_one_sentence_and_writes_nothing(
    tmp_path: Path, data: Path, run: Path, arguments: list[str], sentence: str
) -> None:
    places = {name: tmp_path / name for name in ("occupied", "empty", "truncated", "weightless")}
    places["occupied"].mkdir()
    (places["occupied"] / "thesis.tex").write_text("mine")
    places["empty"].mkdir()
    shutil.copytree(data, places["truncated"])
    grasp = places["truncated"] / "demo-000-grasp-007.npz"
    grasp.write_bytes(grasp.read_bytes()[:-100])
    shutil.copytree(run, places["weightless"])
    (places["weightless"] / "model.safetensors").unlink()
    before = contents(tmp_path), contents(run), contents(data)

    done = equigrasp(*(argument.format(**places, data=data, run=run) for argument in arguments), cwd=tmp_path)

    assert done.returncode == 2, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("equigrasp: ")]
    assert len(errors) == 1
    assert sentence in errors[0]
    assert "Traceback" not in done.stderr
    assert (contents(tmp_path), contents(run), contents(data)) == before


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["models", "--diff", "leg-unet", "leg-unt"], "did you mean 'leg-unet'"),
        (["train", "--data", "{data}", "--model", "leg-steerible"], "did you mean 'leg-steerable'"),
        (["train", "--data", "{data}", "--text-encoder", "minilmm"], "did you mean 'minilm'"),
        (["train", "--data", "{data}", "--text-encoder", "clip-rn50"], "are not on this machine"),
        (["train", "--data", "{data}", "--model", "cliport-rn50", "--clip-weights", "{wrong}"], "is damaged"),
        (["train", "--data", "{data}", "--model", "fcgq", "--out", "{run}"], "name 'leg-steerable', not 'fcgq'"),
        (["evaluate", "--run", "{data}"], "is not a run folder"),
        (["evaluate", "--run", "{weightless}"], "no weights"),
        (["evaluate", "--run", "{another}"], "its rings is 'gaussian', and by the config.json beside it 'smooth'"),
        (["show", "--run", "{another}"], "its rings is 'gaussian', and by the config.json beside it 'smooth'"),
        (["equivariance", "--run", "{another}"], "its rings is 'gaussian', and by the config.json beside it 'smooth'"),
        (["share", "--run", "{another}", "--out", "out"], "its rings is 'gaussian', and by the config.json"),
        (["export", "--run", "{another}", "--out", "policy.pt2"], "its rings is 'gaussian', and by the config.json"),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else "",
)
def test_a_mistake_is_said_before_torch_is_there(
    tmp_path: Path, data: Path, run: Path, arguments: list[str], sentence: str
) -> None:
    places = {name: tmp_path / name for name in ("weightless", "another", "wrong.safetensors")}
    places["wrong"] = places.pop("wrong.safetensors")
    places["wrong"].write_bytes(b"no weights")
    for name in ("weightless", "another"):
        shutil.copytree(run, places[name])
    (places["weightless"] / "model.safetensors").unlink()
    plan = places["another"] / "config.json"
    # the same shapes, and other kernels
    plan.write_text(plan.read_text().replace('"rings": "gaussian"', '"rings": "smooth"'))
    before = contents(tmp_path), contents(run)
    spoken = [argument.format(**places, data=data, run=run) for argument in arguments]
    program = f"""
import sys
from equigrasp.cli import main
try:
    main({spoken!r})
finally:
    print("torch" in sys.modules)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=500, cwd=tmp_path
    )

    assert done.returncode == 2, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("equigrasp: ")]
    assert len(errors) == 1, done.stderr
    assert sentence in errors[0]
    assert done.stdout.splitlines()[-1] == "False"
    assert (contents(tmp_path), contents(run)) == before


@pytest.mark.parametrize("command", ["collect", "train"])
def test_sigkill_at_random_moments_loses_nothing(tmp_path: Path, data: Path, run: Path, command: str) -> None:
    """A killed command, run again, ends with the very files of an undisturbed one."""
    out = tmp_path / "out"
    arguments = {
        "collect": ["collect", "--camera", "overhead", "--out", out],
        "train": [*TRAIN, "--data", data, "--out", out],
    }[command]
    moments = random.Random(command)
    for _ in range(KILLS):
        process = subprocess.Popen(
            [sys.executable, "-m", "equigrasp", *map(str, arguments)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while not out.exists() and process.poll() is None:
            time.sleep(0.01)
        time.sleep(moments.uniform(0, 10))
        process.send_signal(signal.SIGKILL)
        process.wait()
    done = equigrasp(*arguments)
    assert done.returncode == 0, done.stderr
    assert contents(out) == contents({"collect": data, "train": run}[command])

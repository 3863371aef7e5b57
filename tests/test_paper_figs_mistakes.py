"""What a script of a figure is given and cannot draw is one sentence that names it, before anything is written."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import by_task
import pytest
import tables
from loading import EVALUATION, GRASP, load
from test_paper_figs import line, written
from test_paper_figs_evaluated import line as evaluation

from equigrasp.errors import InputError
from equigrasp.models import MODELS
from equigrasp.study.matrix import CostJob

ROOT = Path(__file__).parent.parent
COST = {
    **CostJob(replace(MODELS["leg-unet"], text_encoder="hashing"), 1, 2).cell(),
    **{"device": {"processor": "mine"}, "seconds": {"step": 0.1, "read_out": 0.1}},
    **{"parameters": 1, "frozen_parameters": 0, "memory": 1},
}
SOUND = {"grasp": line("leg-unet", 0, 90, 0.9), "cost": COST, "evaluation": evaluation()}
Change = Callable[[dict[str, Any]], object]


def test_sound_lines_are_taken(tmp_path: Path) -> None:
    cells, costs = load([written(tmp_path, *SOUND.values())])
    assert (len(cells), len(costs)) == (2, 1)


def without(name: str) -> Change:
    *above, last = name.split(".")

    def change(found: dict[str, Any]) -> None:
        for key in above:
            found = found[key]
        del found[last]

    return change


@pytest.mark.parametrize(
    ("kind", "change", "sentence"),
    [
        *(("grasp", without(name), f"it has no {name}") for name in (*GRASP, "clip_pretrained")),
        *(("evaluation", without(name), f"it has no {name.rpartition('.')[2]}") for name in EVALUATION),
        ("grasp", without("config.text_encoder"), "it has no text_encoder"),
        ("cost", without("device"), "it has no device"),
        ("cost", without("device.processor"), "it has no processor"),
        ("cost", without("seconds.step"), "it has no step"),
        ("grasp", lambda found: found.update(demos="1"), "its demos is '1'"),
        ("grasp", lambda found: found.update(steps=True), "its steps is True"),
        ("grasp", lambda found: found.update(config=None), "its config is None"),
        ("grasp", lambda found: found["single_shot"].update(correct=None), "NoneType"),
        ("grasp", lambda found: found.update(validation_successes={"last": 3}, validation=5), "last"),
        ("evaluation", lambda found: found.update(run={}), "it has no task"),
        ("evaluation", lambda found: found.update(run=[]), "list indices"),
        ("evaluation", lambda found: found["policy"].pop("correct"), "it has no correct"),
    ],
)
def test_a_line_that_is_no_result_is_named(tmp_path: Path, kind: str, change: Change, sentence: str) -> None:
    broken = json.loads(json.dumps(SOUND[kind]))
    change(broken)
    path = written(tmp_path, SOUND["grasp"] | {"seed": 1}, {"of": "something else"}, broken)
    with pytest.raises(InputError) as raised:
        load([path])
    said = str(raised.value)
    assert said.startswith(f"line 3 of {path} is no result")
    assert sentence in said
    assert "\n" not in said


@pytest.mark.parametrize("main", [tables.main, by_task.main])
def test_a_script_says_it_in_one_sentence(
    main: Callable[[list[str]], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, SOUND["grasp"] | {"demos": "1"})
    for results, out, sentence in (
        (path, "out", f"line 1 of {path} is no result"),
        (tmp_path, "out", f"{tmp_path} cannot be read as results"),
        (tmp_path / "none", "out", f"there is no file {tmp_path / 'none'}; `equigrasp study"),
        (path, path.name, f"{path} is a file, not a folder; choose another --out"),
        (path, f"{path.name}/deep", f"{path} is a file, not a folder; choose another --out"),
    ):
        with pytest.raises(SystemExit, match="2"):
            main(["--results", str(results), "--out", str(tmp_path / out)])
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.partition(": ")[2].startswith(sentence)
        assert said.err.count("\n") == 1
    assert {each.name for each in tmp_path.iterdir()} == {path.name}


def test_a_row_of_table_4_that_is_stopped_says_that_it_goes_on(tmp_path: Path) -> None:
    asked = "--run NO_STEERABILITY --demos 1 --seeds 0 --steps 100000 --tasks pick-by-part --camera overhead --turned 0"
    command = [sys.executable, ROOT / "paper_figs" / "table4.py", *asked.split(), "--out", tmp_path / "study"]
    # a group of its own, as a terminal gives it, whose Ctrl-C reaches all of it
    process = subprocess.Popen(
        list(map(str, command)),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a shell's background job inherits that Ctrl-C is ignored, and so would the command
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    try:
        until = time.monotonic() + 300
        while not list((tmp_path / "study").glob("data/*/*")):
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said.splitlines()[-1] == "table4.py: stopped; with --run the same command goes on from here"
    assert "Traceback" not in said

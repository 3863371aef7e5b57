"""Where commands write and what they draw: a place that cannot be written to is one sentence, said before any work."""

from __future__ import annotations

import errno
import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folders import contents

from equigrasp.artefacts import PARTIAL
from equigrasp.cli import COMMANDS, main
from equigrasp.errors import WorkerLostError
from equigrasp.grasp import Demonstration
from equigrasp.pictures import Query, draw
from equigrasp.sharing.shareable import Shareable


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, data: Path) -> Path:
    out = tmp_path_factory.mktemp("places") / "run"
    options = ["--steps", "2", "--threads", "1", "--text-encoder", "hashing"]
    main(["train", "--data", str(data), "--out", str(out), *options])
    return out


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (["quickstart", "--model", "leg-unt", "--out", "new"], "there is no model 'leg-unt'"),
        (["quickstart", "--steps", "0", "--out", "new"], "--steps is 0"),
        (["quickstart", "--queries", "0", "--out", "new"], "--queries is 0, but it must be from 1 to"),
        (["quickstart", "--out", "file/new"], "file is a file, not a folder"),
        (["quickstart", "--out", "folder"], "folder/wrong is a file, not a folder"),
        (["bench", "--only", "observation", "--out", "folder"], "--out is folder, which is a folder; name a file"),
        (["bench", "--only", "observation", "--threads", "0"], "--threads is 0, but it must be from 1 to 1024"),
        (["bench", "--only", "inference", "--text-encoder", "clip-rn50:nope"], "nope"),
        (["share", "--run", "RUN", "--out", "file/new"], "file is a file, not a folder"),
        (["export", "--run", "RUN", "--out", "file/new.pt2"], "file is a file, not a folder"),
        (["show", "--run", "RUN", "--out", "file/new.png"], "file is a file, not a folder"),
        (["show", "--run", "RUN", "--out", "new"], "must end in .png or .pdf"),
        (["show", "--run", "RUN", "--out", "new.xyz"], "must end in .png or .pdf"),
        (["show", "--run", "RUN", "--out", "folder.png"], "folder.png, which is a folder; name a file"),
        (["tasks", "--gallery", "file/new"], "file is a file, not a folder"),
        (["tasks", "--gallery", "folder"], "--gallery is folder/tasks.png, which is a folder; name a file"),
        (["tasks", "--gallery", "folder.png"], "--gallery is folder.png/parts.png, which is a folder; name a file"),
        (["tasks", "--gallery", "new", "--task", "pick-frut"], "there is no task 'pick-frut'"),
        (["tasks", "--gallery", "new", "--task", "pick-fruit"], "leave one of them out"),
        (["collect", "--out", "a" * 300], f"File name too long: {'a' * 300}; choose another place"),
    ],
)
def test_a_place_or_a_name_that_cannot_be_is_one_sentence_and_leaves_nothing(
    command: list[str],
    sentence: str,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("a file")
    for name in ("folder", "folder.png"):
        (tmp_path / name).mkdir()
    (tmp_path / "folder" / "tasks.png").mkdir()
    (tmp_path / "folder.png" / "parts.png").mkdir()
    (tmp_path / "folder" / "wrong").write_text("another file")
    before, trained = contents(tmp_path), contents(run)
    with pytest.raises(SystemExit) as stopped:
        main([str(run) if each == "RUN" else each for each in command])
    assert stopped.value.code == 2
    said = capsys.readouterr()
    assert sentence in said.err
    assert said.err.count("\n") == 1
    assert not said.out, "no work was begun"
    assert (contents(tmp_path), contents(run)) == (before, trained)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "folder.png"]


def test_a_shared_policy_that_could_not_be_written_leaves_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(self: Shareable, folder: Path, **_: Any) -> None:
        folder.mkdir()
        (folder / "half").write_text("")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Shareable, "save_pretrained", half)
    with pytest.raises(SystemExit):
        main(["share", "--run", str(run), "--out", str(tmp_path / "shared")])
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("command", ["share", "export"])
def test_what_a_killed_command_left_of_its_out_is_gone_when_it_is_there(
    command: str, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("equigrasp.cli.export._test_scenes", lambda policy, plan: [])
    monkeypatch.setattr("equigrasp.export.SCENES", 1)
    out = tmp_path / "policy.pt2"
    (tmp_path / f"{PARTIAL}{10**20}-0a1b2c3d-{out.name}").write_text("half")
    main([command, "--run", str(run), "--out", str(out)])
    assert [*tmp_path.iterdir()] == [out]


def test_what_stands_between_dollars_is_no_mathematics(demonstrations: list[Demonstration], tmp_path: Path) -> None:
    """Typeset, this is a fraction without its terms, which matplotlib refuses when it saves."""
    one, out = demonstrations[0], tmp_path / "formula.png"
    bare, photograph = np.zeros((36, 80, 160), dtype=np.float32), np.zeros((4, 4, 3), dtype=np.uint8)
    asked, lifted = r"pick the $\frac$ mug", r"lifted the $\frac$ mug"
    query = Query(one.observation, asked, one.grasp, None, bare, photograph, lifted, True)
    draw([query], out, r"a run called $\frac$")
    assert out.read_bytes().startswith(b"\x89PNG")
    assert [*tmp_path.iterdir()] == [out], "and no part of a file"


def test_letters_that_the_font_lacks_are_no_warning(demonstrations: list[Demonstration], tmp_path: Path) -> None:
    one = demonstrations[0]
    bare, photograph = np.zeros((36, 80, 160), dtype=np.float32), np.zeros((4, 4, 3), dtype=np.uint8)
    query = Query(one.observation, "拿起杯子", one.grasp, None, bare, photograph, "lifted", True)
    for ending in ("png", "pdf"):
        draw([query], tmp_path / f"picture.{ending}", "a run")


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_whoever_stops_reading_hears_no_traceback(unbuffered: str) -> None:
    """As `equigrasp tasks | head -1`; the reader is gone before the first line."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", "from equigrasp.cli import main; main(['tasks'])"]
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, env=environment)
    os.close(writer)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")


def test_a_help_that_nobody_takes_is_no_traceback() -> None:
    """As `equigrasp --help | head -1`, and onto a full disk."""
    command = [sys.executable, "-m", "equigrasp", "train", "--help"]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "equigrasp: No space left on device: the output; free some space\n"


def test_ctrl_c_while_it_starts_is_a_sentence() -> None:
    """It comes as tyro is imported, before any command is known."""
    code = """
import os, signal, sys
# who runs in the background has it ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
class Stop:
    def find_spec(self, name, *_):
        if name == "tyro":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Stop())
sys.argv = ["equigrasp", "--help"]
import runpy
runpy.run_module("equigrasp", run_name="__main__")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "equigrasp: stopped; the same command begins anew\n"


@pytest.mark.parametrize("columns", ["1", "5"])
def test_a_terminal_of_no_width_has_a_help(columns: str) -> None:
    command, environment = [sys.executable, "-m", "equigrasp", "train", "--help"], os.environ | {"COLUMNS": columns}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "--data" in done.stdout


def test_who_stops_reading_an_evaluation_loses_none_of_it(run: Path, tmp_path: Path) -> None:
    """As `equigrasp evaluate --run RUN --out FILE | head -1`."""
    reader, writer = os.pipe()
    os.close(reader)
    out, record = tmp_path / "trials.json", tmp_path / "results.jsonl"
    command = [sys.executable, "-m", "equigrasp", "evaluate", "--run", str(run), "--protocol", "single-shot"]
    command += ["--scenes", "1", "--threads", "1", "--out", str(out), "--record", str(record)]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert done.returncode == 128 + signal.SIGPIPE, done.stderr
    assert len(json.loads(out.read_text())["policy"]["trials"]) == 1
    assert record.read_text().count("\n") == 1


def test_a_terminal_of_few_letters_is_no_traceback(tmp_path: Path) -> None:
    """Names of folders and objects are their makers'; a stdout that knows no umlaut gets its number."""
    command = [sys.executable, "-m", "equigrasp", "collect", "--out", str(tmp_path / "d\u00e4ta")]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert "d\\xe4ta" in done.stdout


@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_a_process_without_streams_does_its_work(tmp_path: Path, closed: str) -> None:
    command = shlex.join([sys.executable, "-m", "equigrasp", "collect", "--camera", "overhead", "--out", str(tmp_path)])
    done = subprocess.run(["bash", "-c", f"{command} {closed}"], stdout=subprocess.PIPE, check=False)
    assert done.returncode == 0
    assert len([*tmp_path.glob("*.npz")]) == 23


def test_a_folder_that_is_gone_is_one_sentence(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    command = shlex.join([sys.executable, "-m", "equigrasp", "collect"])
    script = f"cd {shlex.quote(str(gone))} && rmdir {shlex.quote(str(gone))} && {command}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "equigrasp: the current folder is gone; change to another" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_another_pipe_that_breaks_is_no_reader_that_left(monkeypatch: pytest.MonkeyPatch) -> None:
    def lose(_: object) -> None:
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr(COMMANDS["collect"], "execute", lose)
    with pytest.raises(BrokenPipeError):
        main(["collect"])


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (PermissionError(errno.EACCES, "Permission denied", "far/away"), "far/away; choose another place, or change "),
        (OSError(errno.EROFS, "Read-only file system", "far/away"), "far/away; choose another place\n"),
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device: the output; free some space\n"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_place_that_is_refused_has_a_way_out(
    error: OSError, sentence: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(_: object) -> None:
        raise error

    monkeypatch.setattr(COMMANDS["collect"], "execute", refused)
    with pytest.raises(SystemExit) as stopped:
        main(["collect"])
    assert stopped.value.code == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(("command", "way_on"), [("difficulty", "begins anew"), ("collect", "goes on from here")])
@pytest.mark.parametrize("stop", [KeyboardInterrupt(), WorkerLostError("stopped")], ids=["ctrl-c", "lost"])
def test_a_stopped_command_promises_what_it_keeps(
    command: str, way_on: str, stop: BaseException, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(_: object) -> None:
        raise stop

    monkeypatch.setattr(COMMANDS[command], "execute", stopped)
    with pytest.raises(SystemExit) as ended:
        main([command])
    assert ended.value.code == (130 if isinstance(stop, KeyboardInterrupt) else 1)
    assert capsys.readouterr().err == f"equigrasp: stopped; the same command {way_on}\n"


def test_a_mistake_about_difficulty_is_said_without_a_simulator() -> None:
    code = "from equigrasp.cli import main; main(['difficulty', '--scenes', '0'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "equigrasp: --scenes is 0, but it must be at least 1\n"

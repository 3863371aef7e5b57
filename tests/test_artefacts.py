"""Files are written whole or not at all, and a folder belongs to one plan."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from equigrasp import language
from equigrasp.artefacts import (
    PARTIAL,
    alone,
    append_line,
    cache_folder,
    check_folder,
    check_writable,
    open_folder,
    partial_name,
    read_json,
    remove_partials,
    remove_partials_of,
    write_atomically,
    write_figure,
    write_json,
)
from equigrasp.errors import BusyError, InputError, unknown
from equigrasp.fewer_colors import fewer_colors


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")
    with pytest.raises(TypeError):
        write_atomically(path, "not bytes")  # ty: ignore[invalid-argument-type]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_a_figure_that_cannot_be_drawn_leaves_the_old_one(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"figure.{ending}"
    figure = Figure()
    write_figure(path, figure, dpi=20)
    old = path.read_bytes()
    assert old.startswith({"png": b"\x89PNG", "pdf": b"%PDF"}[ending])
    figure.text(0.5, 0.5, r"$\nothing$")
    with pytest.raises(ValueError, match="nothing"):
        write_figure(path, figure, dpi=20)
    assert path.read_bytes() == old
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_small_thing_keeps_its_colour_before_a_wide_background() -> None:
    picture = np.full((300, 400, 3), 255, dtype=np.uint8)
    # shades of gray, as many as a palette has, and a spot
    picture[100:] = (np.arange(400) * 255 // 400)[:, None]
    picture[10:20, 10:20] = 0, 114, 178
    fewer = np.asarray(fewer_colors(Image.fromarray(picture), 64).convert("RGB"))
    assert len(np.unique(fewer.reshape(-1, 3), axis=0)) <= 64
    assert (fewer[:10] == 255).all(), "paper is white"
    assert np.abs(fewer[15, 15].astype(int) - [0, 114, 178]).max() <= 4


def test_several_who_write_one_file_at_once_leave_one_of_their_contents(tmp_path: Path) -> None:
    path = tmp_path / "file"
    contents = [bytes([each]) * 200_000 for each in range(4)]
    seen: set[bytes] = set()
    with ThreadPoolExecutor(len(contents)) as threads:
        writing = [
            threads.submit(lambda what: [write_atomically(path, what) for _ in range(20)], each) for each in contents
        ]
        while not all(each.done() for each in writing):
            if path.exists():
                seen.add(path.read_bytes())
        for each in writing:
            each.result()
    assert seen | {path.read_bytes()} <= set(contents)
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_a_disk_that_has_no_room_keeps_nothing_of_a_file(tmp_path: Path) -> None:
    code = "import resource, signal, sys; from pathlib import Path; from equigrasp.artefacts import write_atomically\n"
    code += "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
    code += "write_atomically(Path(sys.argv[1]), bytes(2000))"
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "file"], capture_output=True, text=True, check=False)
    assert "File too large" in done.stderr
    assert not list(tmp_path.iterdir())


def test_equal_values_give_equal_bytes(tmp_path: Path) -> None:
    write_json(tmp_path / "a", {"x": 1, "y": (2, 3)})
    write_json(tmp_path / "b", {"y": [2, 3], "x": 1})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_same_plan_goes_on(tmp_path: Path) -> None:
    assert not open_folder(tmp_path / "out", "plan.json", {"task": "x", "size": (1, 2)}, megabytes=1)
    assert open_folder(tmp_path / "out", "plan.json", {"task": "x", "size": (1, 2)}, megabytes=1)


@pytest.mark.parametrize("theirs", [["x", "x"], ["x", "y"]])
def test_who_begins_a_folder_at_the_same_instant_agrees_on_its_plan(tmp_path: Path, theirs: list[str]) -> None:
    code = "import sys; from pathlib import Path; from equigrasp.artefacts import open_folder\n"
    code += "from equigrasp.errors import InputError\n"
    code += "input()\n"
    code += "for each in range(200):\n"
    code += "    try: open_folder(Path(sys.argv[1]) / str(each), 'plan.json', {'task': sys.argv[2]}, 1)\n"
    code += "    except InputError as error: print(error)\n"
    command = [sys.executable, "-c", code, str(tmp_path)]
    both = [subprocess.Popen([*command, task], stdin=-1, stdout=-1, text=True) for task in theirs]
    for each in both:
        assert each.stdin is not None
        each.stdin.write("\n")
        each.stdin.flush()
    refused = [line for each in both for line in each.communicate()[0].splitlines()]
    assert [each.returncode for each in both] == [0, 0]
    assert len(refused) == (0 if theirs == ["x", "x"] else 200)
    assert all("was begun with task" in sentence for sentence in refused)
    assert {path.name for path in tmp_path.rglob("*.json")} == {"plan.json"}


def test_a_folder_is_held_by_one_until_he_dies(tmp_path: Path) -> None:
    code = "import sys, time; from pathlib import Path; from equigrasp.artefacts import alone\n"
    code += "with alone(Path(sys.argv[1]), 'training'): print(flush=True); time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=-1) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(BusyError, match="another training is at work in"), alone(tmp_path, "training"):
            pass
        other.send_signal(signal.SIGKILL)
    with alone(tmp_path, "training"):
        assert not open_folder(tmp_path, "plan.json", {}, 1)


def test_a_disk_that_knows_no_locks_is_none_that_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown_here(file: int, how: int) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", unknown_here)
    with alone(tmp_path, "study"):
        append_line(tmp_path / "results.jsonl", {"a": 1})
    assert (tmp_path / "results.jsonl").read_text() == '{"a": 1}\n'


def test_what_a_killed_process_left_is_not_foreign(tmp_path: Path) -> None:
    (tmp_path / (PARTIAL + "plan.json")).write_text("{")
    assert not open_folder(tmp_path, "plan.json", {}, megabytes=1)
    remove_partials(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]


def test_a_full_disk_is_said_by_the_file_that_found_no_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as error:
        write_atomically(tmp_path / "new.json", b"{}")
    assert error.value.filename == str(tmp_path / "new.json")
    assert list(tmp_path.iterdir()) == []


def test_a_user_whose_home_nobody_knows_hears_of_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """A container's numeric user with a clean environment; embeddings do without a cache, meshes cannot."""
    monkeypatch.delenv("EQUIGRASP_CACHE", raising=False)

    def nobody(path: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "expanduser", nobody)
    with pytest.raises(InputError, match="set EQUIGRASP_CACHE to a folder"):
        cache_folder("objects")
    monkeypatch.setattr(language, "_memory", {})
    assert language.embed("hashing", ["pick up the mug"]).shape == (1, 512)


def test_what_another_process_is_writing_stays_until_it_is_dead(tmp_path: Path) -> None:
    """As a training ends while `evaluate` writes into the same run folder."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        written = tmp_path / f"{PARTIAL}{other.pid}-0a1b2c3d-evaluation.json"
        own, impossible = (tmp_path / f"{PARTIAL}{number}-0a1b2c3d-new" for number in (os.getpid(), 10**20))
        for partial in (written, own, impossible):
            partial.write_text("{")
        remove_partials(tmp_path)
        assert list(tmp_path.iterdir()) == [written]
        other.kill()
    remove_partials(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_was_left_of_one_name_goes_and_no_other_partial(tmp_path: Path) -> None:
    out = tmp_path / "my-[run]"
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        written = tmp_path / f"{PARTIAL}{other.pid}-0a1b2c3d-{out.name}"
        others = [f"{PARTIAL}{10**20}-0a1b2c3d-{name}" for name in ("[run]", "r", "not-my-[run]")]
        for name in (written.name, *others):
            (tmp_path / name).write_text("half")
        (tmp_path / f"{PARTIAL}{10**20}-0a1b2c3d-{out.name}").write_text("half")
        folder = tmp_path / f"{PARTIAL}{10**20}-4e5f6a7b-{out.name}"
        folder.mkdir()
        (folder / "half").write_text("")
        remove_partials_of(out)
        assert {each.name for each in tmp_path.iterdir()} == {written.name, *others}
        other.kill()


@pytest.mark.parametrize("name", ["a" * 251 + ".pt2", "ä" * 125 + "b.pt2", "b" + "ä" * 125 + ".pt2"])
def test_a_name_as_long_as_the_disk_takes_can_be_written(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    partial = partial_name(path)
    assert partial.suffix == ".pt2"
    partial.name.encode()  # no part of a letter
    partial.write_text("half")
    write_atomically(path, b"whole")
    remove_partials_of(path)
    assert [each.name for each in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda out: out.write_text("mine"), "is a file"),
        (lambda out: (out.mkdir(), (out / "thesis.tex").write_text("mine")), "thesis.tex"),
        (lambda out: open_folder(out, "plan.json", {"task": "y"}, 1), "task 'y', not 'x'"),
        (lambda out: (out.mkdir(), (out / "plan.json").write_text("{")), "damaged"),
    ],
    ids=["a file", "other content", "another plan", "damaged plan"],
)
def test_a_folder_that_is_not_ours_is_left_alone(tmp_path: Path, spoil, sentence: str) -> None:
    out = tmp_path / "out"
    spoil(out)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match=sentence):
        open_folder(out, "plan.json", {"task": "x"}, megabytes=1)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_too_little_room_is_said_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="MB free"):
        open_folder(tmp_path / "out", "plan.json", {}, megabytes=1e12)
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a small disk")
def test_a_disk_that_is_really_full(tmp_path: Path) -> None:
    small = tmp_path / "small"
    small.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(small)], check=False).returncode:
        pytest.skip("this machine lets nobody mount")
    try:
        with pytest.raises(InputError, match="MB free"):
            open_folder(small / "out", "plan.json", {}, megabytes=2)
        path = small / "file"
        write_atomically(path, b"old")
        with pytest.raises(OSError, match="No space left"):
            write_atomically(path, bytes(2_000_000))
        assert path.read_bytes() == b"old"
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_two_writers_lose_no_line(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    code = "import sys; from pathlib import Path; from equigrasp.artefacts import append_line\n"
    code += "[append_line(Path(sys.argv[1]), [sys.argv[2], each]) for each in range(60)]"
    writers = [subprocess.Popen([sys.executable, "-c", code, str(path), name]) for name in ("one", "other")]
    assert [writer.wait() for writer in writers] == [0, 0]
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert sorted(lines) == [[name, each] for name in ("one", "other") for each in range(60)]
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_line_is_there_once_and_alone(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text('{"a": 1}')
    for _ in range(2):
        append_line(path, {"b": 2})
    assert path.read_text() == '{"a": 1}\n{"b": 2}\n'


def test_a_line_leaves_others_as_they_are_whatever_their_encoding(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    path.write_bytes(b'{"note": "caf\xe9"}\r\n')
    append_line(path, {"b": 2})
    assert path.read_bytes() == b'{"note": "caf\xe9"}\r\n{"b": 2}\n'


def test_a_line_goes_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    there, here = tmp_path / "far" / "all.jsonl", tmp_path / "results.jsonl"
    here.symlink_to(there)
    for value in (1, 2):
        check_writable(here, "--record", lines=True)
        append_line(here, value)
    assert here.is_symlink()
    assert there.read_text() == "1\n2\n"
    assert [entry.name for entry in there.parent.iterdir()] == [there.name]


@pytest.mark.parametrize("lines", [False, True])
def test_a_device_or_a_pipe_is_not_replaced(tmp_path: Path, lines: bool) -> None:
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", Path(os.devnull)):
        with pytest.raises(InputError, match="which is a device or a pipe"):
            check_writable(place, "--out", lines=lines)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("nowhere/results.jsonl", None, "there is no folder"),
        ("", None, "which is a folder"),
        ("results.jsonl", '{"a": 1}\n{"b"', "the last line of .* is not whole"),
    ],
)
def test_where_no_line_can_be_added_is_said_before_work(
    tmp_path: Path, name: str, content: str | None, sentence: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=sentence):
        check_writable(path, "--record", lines=True)
    assert content is None or path.read_text() == content


def test_a_folder_that_cannot_be_made_is_said_before_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="file is a file, not a folder; choose another --out"):
            check_folder(folder, "--out")
    check_folder(tmp_path / "new" / "below", "--out")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_json_that_is_none_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "list").write_text(json.dumps([1]))
    for name in ("missing", "list"):
        with pytest.raises(InputError, match=name):
            read_json(tmp_path / name, "a plan")


def test_the_nearest_name_is_offered() -> None:
    assert "'pick-by-part'" in str(unknown("task", "pick-by-prat", ["pick-by-part", "pick-fruit"]))
    assert "there are a, b" in str(unknown("task", "zzz", ["b", "a"]))

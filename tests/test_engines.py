"""Where work runs must not be seen in what it gives: real processes, some of them killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from children import children
from folders import contents

from equigrasp.cli.common import make_env
from equigrasp.collection import Collection
from equigrasp.demonstrations import Demonstrator, demonstrate, encode
from equigrasp.engines import Local, Ray
from equigrasp.errors import InputError, WorkerLostError

if TYPE_CHECKING:
    # each worker imports this file: it must not cost them the simulator
    from tasks.env import GraspEnv

COMMAND = [sys.executable, "-m", "equigrasp", "collect", "--camera", "overhead", "--workers", "2", "--out"]


@dataclass
class Square:
    """Squares; says where, and how often this copy was used; dies at one item, or fails at another."""

    dies_at: int = -1
    fails_at: int = -1

    @cached_property
    def used(self) -> list[int]:
        return []

    def __call__(self, item: int) -> tuple[int, int, int]:
        if item == self.dies_at:
            os.kill(os.getpid(), signal.SIGKILL)
        if item == self.fails_at:
            raise InputError(f"{item} is not liked")
        self.used.append(item)
        return item**2, os.getpid(), len(self.used)


@dataclass
class Watched:
    """Work, and what of these modules it made its process load."""

    work: Callable[[Any], Any]

    def __call__(self, item: Any) -> tuple[Any, set[str]]:
        done = self.work(item)
        return done, {"torch", "escnn", "transformers", "matplotlib", "ray", "pybullet"} & set(sys.modules)


def processes_of(parent: int) -> list[int]:
    """The ids of its workers."""
    return children(parent, "equigrasp.engines.worker")


@pytest.mark.parametrize("workers", [1, 3])
def test_every_item_is_worked_on_once(workers: int) -> None:
    results = dict(Local(workers)(Square(), range(20)))
    assert {item: square for item, (square, _, _) in results.items()} == {item: item**2 for item in range(20)}
    used = [(process, count) for _, process, count in results.values()]
    # each process counts its own: the callable was copied once, and kept
    assert len(set(used)) == 20
    assert (os.getpid() in dict(used)) == (workers == 1)
    assert len(dict(used)) <= workers
    assert not processes_of(os.getpid())


def test_nothing_to_do_is_done_at_once() -> None:
    assert list(Local(3)(Square(), [])) == []


def test_a_killed_worker_is_one_sentence_and_leaves_nobody() -> None:
    with pytest.raises(WorkerLostError, match="killed from outside") as error:
        list(Local(2)(Square(dies_at=7), range(20)))
    assert "\n" not in str(error.value)
    assert not processes_of(os.getpid())


def test_what_a_worker_raises_arrives_and_ends_the_others() -> None:
    with pytest.raises(InputError, match="7 is not liked") as error:
        list(Local(2)(Square(fails_at=7), range(20)))
    assert str(error.value) == "7 is not liked"
    assert not processes_of(os.getpid())


def test_leaving_early_leaves_nobody() -> None:
    with closing(Local(2)(Square(), range(1000))) as results:
        next(results)
    assert not processes_of(os.getpid())


def large(item: int) -> bytes:
    """An answer that takes far longer to send than to make: most of the time a worker is in the middle of one."""
    return bytes(40_000_000)


def test_leaving_while_answers_are_being_sent_leaves_nobody() -> None:
    with closing(Local(2)(large, range(1000))) as results:
        for _ in range(5):
            next(results)
    assert not processes_of(os.getpid())


@pytest.mark.parametrize("what", ["result", "error"])
def test_what_cannot_be_sent_is_told(what: str) -> None:
    with pytest.raises(Exception, match="lock"):
        list(Local(2)(partial(unsendable, what), range(4)))
    assert not processes_of(os.getpid())


def unsendable(what: str, item: int) -> object:
    lock = threading.Lock()
    if what == "error":
        raise ValueError(lock)
    return lock


def test_work_of_a_script_needs_no_main_guard(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(
        "from equigrasp.engines import Local\n"
        "def double(item): return 2 * item\n"
        "print(sorted(Local(2)(double, range(4))))\n"
    )
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("[(0, 0), (1, 2), (2, 4), (3, 6)]\n", 0), done.stderr


@pytest.mark.parametrize("engine", [Local, Ray])
def test_no_worker_is_refused(engine: type[Local | Ray]) -> None:
    with pytest.raises(InputError, match="--workers is 0"):
        engine(workers=0)


def test_an_address_without_ray_is_refused() -> None:
    with pytest.raises(InputError, match="--engine ray"):
        Local(address="127.0.0.1:6379")


@pytest.mark.parametrize(
    ("address", "sentence"),
    [("auto", "HOST:PORT"), ("127.0.0.1", "HOST:PORT"), ("127.0.0.1:1", "no Ray cluster"), ("[::1]:99999", "no Ray")],
)
def test_addresses_where_nobody_answers_are_refused_at_once(address: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Ray(address=address)


def test_without_ray_the_way_out_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[ray\]'"):
        Ray()


def test_workers_make_the_same_files_and_never_load_torch(env: GraspEnv, plan: Collection) -> None:
    small = replace(plan, goals=((3, 11, 3), (20, 0)))
    work = Watched(Demonstrator(small, partial(make_env, plan.task, "overhead")))
    results = dict(Local(2)(work, small.grasps()))
    assert set(results) == set(small.grasps())
    for place, (content, modules) in results.items():
        assert content == encode(demonstrate(small, env, *place))
        assert modules == {"pybullet"}


@pytest.fixture
def begun(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[tuple[subprocess.Popen[str], list[int], Path]]:
    """A real command with two workers that has written a first file, in a process group of its own.

    It collects as many demonstrations as the test asks for, one where it does not.
    """
    out, demos = tmp_path / "out", str(getattr(request, "param", 1))
    process = subprocess.Popen(
        [*COMMAND, str(out), "--demos", demos],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a shell's background job inherits that Ctrl-C is ignored, and so would the command
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    # who works is found out before the first file is there: the rest takes a fraction of a second
    workers: list[int] = []
    while not (len(workers) == 2 and list(out.glob("demo-*"))) and process.poll() is None:
        workers = workers if len(workers) == 2 else processes_of(process.pid)
        time.sleep(0.01)
    yield process, workers, out
    if process.poll() is None:
        process.kill()
    process.communicate()


def gone(pids: list[int]) -> bool:
    """Whether all of them end; the test's own limit of patience is generous, as machines are shared."""
    for _ in range(600):
        if not any(Path(f"/proc/{pid}").exists() for pid in pids):
            return True
        time.sleep(0.05)
    return False


def sentences(errors: str) -> list[str]:
    return [line for line in errors.splitlines() if line.startswith("equigrasp: ")]


def test_a_killed_worker_stops_the_command_and_the_same_command_ends_it(begun, data: Path) -> None:
    process, workers, out = begun
    assert len(workers) == 2
    os.kill(workers[0], signal.SIGKILL)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    (sentence,) = sentences(errors)
    assert "killed from outside" in sentence
    assert "Traceback" not in errors
    assert gone(workers)
    # by one worker now: how many there are is no part of the plan
    again = subprocess.run([*COMMAND, str(out), "--workers", "1"], capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert contents(out) == contents(data)


@pytest.mark.parametrize("begun", [400], indirect=True)
def test_ctrl_c_stops_everybody(begun) -> None:
    process, workers, out = begun
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130
    assert sentences(errors) == ["equigrasp: stopped; the same command goes on from here"]
    assert "Traceback" not in errors
    assert gone(workers)
    assert not (out / "manifest.json").exists()


def test_workers_do_not_outlive_a_killed_parent() -> None:
    program = "\n".join(
        [
            "import time",
            "from equigrasp.engines import Local",
            "for _ in Local(2)(time.sleep, [0, 0, 600, 600]): print('begun', flush=True)",
        ]
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert [process.stdout.readline(), process.stdout.readline()] == 2 * ["begun\n"]
        workers = processes_of(process.pid)
        process.kill()
        process.wait()
        assert len(workers) == 2
        assert gone(workers)

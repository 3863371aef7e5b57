"""Processes whose results come in order: they end with whoever asked, and who asked learns when one was lost."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from equigrasp.engines.in_order import in_order
from equigrasp.errors import InputError, WorkerLostError


def slow_if_even(item: int) -> tuple[int, int]:
    """The first of two processes is the slow one."""
    time.sleep(0.05 * (item % 2 == 0))
    return item, os.getpid()


def dies_at_three(item: int) -> int:
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def prints(item: int) -> int:
    print("a line that is no answer", flush=True)
    return item


def refuses(item: int) -> int:
    raise InputError(f"{item} is refused")


def alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_results_come_in_the_order_of_their_items_from_several_processes() -> None:
    results = list(in_order(slow_if_even, range(9), workers=2))
    assert [item for item, _ in results] == list(range(9))
    processes = {process for _, process in results}
    assert len(processes) == 2
    assert os.getpid() not in processes
    assert not any(alive(process) for process in processes)


def test_items_without_an_end_are_taken_as_they_are_needed() -> None:
    results = in_order(slow_if_even, itertools.count(), workers=1)
    _, process = next(results)
    results.close()
    assert not alive(process)


def test_a_process_that_is_killed_is_told() -> None:
    results = in_order(dies_at_three, range(9), workers=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(WorkerLostError, match="killed from outside"):
        list(results)


def test_what_goes_wrong_arrives() -> None:
    with pytest.raises(InputError, match="0 is refused"):
        next(in_order(refuses, range(2), workers=1))


def test_what_the_work_prints_is_not_taken_for_an_answer() -> None:
    assert list(in_order(prints, range(3), workers=1)) == [0, 1, 2]


def test_a_script_needs_no_main_guard_and_its_death_ends_the_processes(tmp_path: Path) -> None:
    """As with a user's ten lines that train on a GPU: processes that run the script again would train too."""
    (tmp_path / "script.py").write_text(
        "import os, sys\n"
        f"sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_in_order import slow_if_even\n"
        "from equigrasp.engines.in_order import in_order\n"
        "results = in_order(slow_if_even, range(99), workers=2)\n"
        "print(next(results)[1], next(results)[1], flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, timeout=60)
    assert done.returncode == -signal.SIGKILL
    processes = [int(each) for each in done.stdout.split()]
    assert len(set(processes)) == 2
    deadline = time.monotonic() + 30
    while any(alive(process) for process in processes):
        assert time.monotonic() < deadline
        time.sleep(0.05)

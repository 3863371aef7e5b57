"""The pytest plugin, as a user runs it: from another folder, on a module of theirs, beside tests of theirs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from equivariance_tests import LAWS

SOURCE = Path(__file__).parent.parent / "docs" / "my_kernel.py"
ABOUT_KERNELS = [law.name for law in LAWS.values() if law.subject.__name__ == "KernelSubject"]


def pytest_in(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    # -p is what the entry point does, and needs no installation
    options = ["-q", "-p", "no:cacheprovider", "-p", "equivariance_tests.plugin", "--pyargs", "equivariance_tests"]
    command = [sys.executable, "-m", "pytest", *options, *arguments]
    # what the outer run was asked to say is not what the inner one says
    environment = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_pytest_aims_the_laws_at_the_users_module(tmp_path: Path) -> None:
    source = SOURCE.read_text()
    (tmp_path / "mine.py").write_text("import torch\n\ntorch.manual_seed(0)\n" + source)
    sound = pytest_in(tmp_path, "-n", "0", "--equigrasp-policy", "mine:make")
    assert sound.returncode == 0, sound.stdout
    # and one that some turn was measured at all
    assert f"{len(ABOUT_KERNELS) + 1} passed" in sound.stdout
    broken = pytest_in(tmp_path, "-n", "0", "--equigrasp-policy", "mine:make_broken")
    assert broken.returncode == 1
    assert "RingKernel: eq. 2, any turn" in broken.stdout
    assert "should have gone to Grasp(u=" in broken.stdout
    assert "5 failed" in broken.stdout


OTHERS = """
import torch
from torch import nn
from equigrasp import fields
from mine import RingKernel as Rings

torch.manual_seed(0)
spaces = {n: fields.gspaces.rot2dOnR2(n) for n in (1, 3)}
of = lambda n, count: fields.FieldType(spaces[n], count * [spaces[n].trivial_repr])


class Still(Rings):
    in_type, out_type = of(1, 3), of(1, 7)


class Thirds(Rings):
    in_type = of(3, 3)
    out_type = fields.FieldType(spaces[3], [spaces[3].irrep(0), spaces[3].irrep(1)])

    def forward(self, embedding):
        # frequencies 0 and 2, which C_3 takes for -1
        return super().forward(embedding)[:, [0, 1, 2]] * torch.tensor([1, 1, -1]).view(3, 1, 1, 1)


class RingKernel(nn.Module):
    embedding_size = 16

    def __init__(self):
        super().__init__()
        self.kappa = Rings()

    def forward(self, observation, embedding):
        return observation.mean(dim=1, keepdim=True).expand(-1, 36, -1, -1) + 0 * embedding.sum()
"""


def test_pytest_and_the_check_are_of_one_opinion(tmp_path: Path) -> None:
    """Of turns that a group has not, pytest says nothing; where no turn can be measured, nothing has been shown."""
    (tmp_path / "mine.py").write_text(SOURCE.read_text())
    (tmp_path / "others.py").write_text(OTHERS)
    still = pytest_in(tmp_path, "-n", "0", "-rs", "--equigrasp-policy", "others:Still")
    assert "test_the_law_holds[Still: lemma 1]" not in still.stdout.replace("SKIPPED", "")
    assert "no law about turns could be measured" in still.stdout
    thirds = pytest_in(tmp_path, "-n", "0", "-rs", "--equigrasp-policy", "others:Thirds", "-k", "not mirror")
    assert thirds.returncode == 0, thirds.stdout
    assert "lemma 1 says nothing about Thirds: no case of it could be measured, its group having none" in thirds.stdout
    excused = pytest_in(
        tmp_path,
        "-n",
        "0",
        "--equigrasp-policy",
        "others:Thirds",
        "--equigrasp-expect",
        "lemma 1=no quarter",
        "-k",
        "lemma",
    )
    assert "'lemma 1' says nothing about Thirds; leave its excuse out" in excused.stdout


def test_pytest_measures_a_policy_and_its_kernel_of_one_name(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SOURCE.read_text())
    (tmp_path / "others.py").write_text(OTHERS)
    both = pytest_in(tmp_path, "-n", "0", "--collect-only", "--equigrasp-policy", "others:RingKernel")
    assert "RingKernel: lemma 1" in both.stdout
    assert "RingKernel: policy: quarter turn" in both.stdout


LISTENS = """

asked, sound = open("asked", "a"), RingKernel.forward


def listen(self, words):
    print(words.tolist(), file=asked, flush=True)
    return sound(self, words)


RingKernel.forward = listen
"""


def test_pytest_draws_the_same_cases_for_a_module_every_time(tmp_path: Path) -> None:
    """Else a module at the edge of a tolerance would pass on one day and fail on the next."""
    (tmp_path / "mine.py").write_text(SOURCE.read_text() + LISTENS)
    for _ in range(2):
        pytest_in(tmp_path, "-n", "0", "--equigrasp-policy", "mine:make", "-k", "steerability")
    asked = (tmp_path / "asked").read_text().splitlines()
    assert asked[: len(asked) // 2] == asked[len(asked) // 2 :]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--equigrasp-policy", "nowhere:make"], "'nowhere' cannot be imported"),
        (["--equigrasp-expect", "lemma 1=why"], "name it with --equigrasp-policy"),
        (["--equigrasp-policy", "mine:make", "--equigrasp-expect", "lemma 1"], "LAW=REASON"),
        (
            ["--equigrasp-policy", "mine:make", "--equigrasp-expect", "group=why"],
            "'group' says nothing about mine:make",
        ),
        (["--equigrasp-policy", "mine:make", "--equigrasp-expect", "lemma=why"], "no law 'lemma'"),
    ],
)
def test_a_mistake_on_pytests_command_line_is_one_sentence(tmp_path: Path, arguments: list[str], sentence: str) -> None:
    (tmp_path / "mine.py").write_text(SOURCE.read_text())
    done = pytest_in(tmp_path, "-n", "0", *arguments)
    assert done.returncode == 4
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


def test_tests_of_the_users_own_run_beside_the_laws(tmp_path: Path) -> None:
    """Left out are those of this package that are about other modules, and no more."""
    (tmp_path / "mine.py").write_text(SOURCE.read_text())
    (tmp_path / "test_mine.py").write_text("def test_mine():\n    raise RuntimeError('my own test ran')\n")
    done = pytest_in(tmp_path, "-n", "0", "--equigrasp-policy", "mine:make", "-k", "mirror or mine", "test_mine.py")
    assert "my own test ran" in done.stdout
    assert "1 failed, 1 passed" in done.stdout, "and of this package the law that was asked for, of this module alone"

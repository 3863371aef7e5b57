"""What numba keeps on disk is compiled anew when its own file changes: so it depends on nothing but that file."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import equigrasp
from equigrasp.compiled import compiled

ROOT = Path(equigrasp.__file__).parents[1]
FILES = [
    file
    for package in ("equigrasp", "tasks", "equivariance_tests")
    for file in sorted((ROOT / package).rglob("*.py"))
    if "@compiled" in file.read_text()
]


def names(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def from_elsewhere(source: str) -> set[str]:
    """The law: no compiled function reads what another file gives. Which it reads, straight or by constants.

    A module that is imported whole, such as numpy, is no number that somebody edits. Annotations are not compiled.
    """
    tree = ast.parse(source)
    imported = {
        alias.asname or alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    made_of: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for name in set().union(*map(names, targets)):
                made_of[name] = names(node.value)
    reading: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and "compiled" in map(ast.unparse, node.decorator_list):
            own = {each.arg for each in node.args.args}
            reading |= set().union(*map(names, node.body)) - own
    found: set[str] = set()
    while reading:
        name = reading.pop()
        found.add(name)
        reading |= made_of.get(name, set()) - found
    return found & imported


def test_no_compiled_function_reads_a_number_of_another_file() -> None:
    assert {file.name for file in FILES} >= {"heightmap.py", "oracle.py", "rasterizer.py"}
    for file in FILES:
        assert not from_elsewhere(file.read_text()), file.name


def test_a_number_of_another_file_breaks_the_law_however_it_comes() -> None:
    function = "@compiled\ndef half(x: Hand) -> float:\n    y = x\n    return y * {}\n"
    start = "import numpy as np\nfrom hands import HAND, WIDTH, Hand\n"
    for constants, read, broken in (
        ("", "WIDTH", {"WIDTH"}),
        ("A, B = HAND.opening, 1\nC: float = A / 2\n", "C", {"HAND"}),
        ("A = 1.0\nB = -np.inf\n", "max(A, B)", set()),
        ("", "x", set()),
    ):
        assert from_elsewhere(start + constants + function.format(read)) == broken


GRASP = """
import dataclasses, sys
import numpy as np
from equigrasp import hand
hand.HAND = dataclasses.replace(hand.HAND, opening=float(sys.argv[1]), finger_width=float(sys.argv[2]))
from equigrasp.workspace import WORKSPACE
from tasks.oracle import FREE, GOAL, Truth, best_grasps
u, v = np.meshgrid(np.arange(WORKSPACE.columns), np.arange(WORKSPACE.rows))
mine = np.abs(WORKSPACE.to_world(np.stack([u, v], axis=-1)) - [0.1, 0.05]).max(axis=-1) < 0.025
height, owner = np.where(mine, 0.03, 0.0).astype(np.float32), np.where(mine, GOAL, FREE).astype(np.int8)
print("grasps", best_grasps(Truth(height, owner, mine, (0.1, 0.05)), 3))
"""


def grasps(cache: Path, opening: float, width: float) -> str:
    """The oracle's grasps of a block, 50 mm on a side, by a hand of that opening and width of fingers, in metres."""
    done = subprocess.run(
        [sys.executable, "-c", GRASP, str(opening), str(width)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
    )
    return done.stdout.partition("grasps")[2]


def test_what_was_compiled_for_one_hand_is_right_for_another(tmp_path: Path) -> None:
    first = grasps(tmp_path / "shared", 0.08, 0.02)
    second = grasps(tmp_path / "shared", 0.06, 0.03)
    assert second == grasps(tmp_path / "clean", 0.06, 0.03)
    assert second != first
    # had the second compiled it anew, this would show nothing
    assert len(list((tmp_path / "shared").rglob("*._scores-*.nbc"))) == 1


def test_a_function_is_compiled_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(*_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr("equigrasp.compiled._FunctionCache.__init__", nowhere)
    assert compiled(lambda x: x + 1)(2) == 3


SUM = """
from equigrasp.compiled import compiled
@compiled
def total(a, b):
    return a + {} * b
"""


def total(folder: Path, factor: int, *numbers: float) -> float:
    """What a process says of a sum whose source has that factor, in a folder whose cache outlives the source."""
    (folder / "sums.py").write_text(SUM.format(factor))
    done = subprocess.run(
        [sys.executable, "-c", f"import sums; print('=', sums.total{numbers})"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"},
    )
    return float(done.stdout.partition("=")[2])


def kept(folder: Path, suffix: str) -> list[Path]:
    return sorted((folder / "cache").rglob(f"*total*{suffix}"))


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", [b"", b"garbage", None], ids=["empty", "garbage", "half"])
def test_a_damaged_cache_costs_a_compilation(tmp_path: Path, suffix: str, damage: bytes | None) -> None:
    assert total(tmp_path, 2, 3, 4) == 11
    (file,) = kept(tmp_path, suffix)
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2] if damage is None else damage)
    assert total(tmp_path, 2, 3, 4) == 11
    (healed,) = kept(tmp_path, suffix)
    assert len(healed.read_bytes()) >= len(content) // 2 + 1


def test_machine_code_of_another_source_is_never_used(tmp_path: Path) -> None:
    assert total(tmp_path, 2, 3, 4) == 11
    (old,) = kept(tmp_path, ".nbc")
    before = old.read_bytes()
    assert total(tmp_path, 5, 3, 4) == 23
    (new,) = kept(tmp_path, ".nbc")
    # an index that was written, and machine code that was not, as on a disk that got full in between
    new.write_bytes(before) if new.name == old.name else (new.unlink(), old.write_bytes(before))
    assert total(tmp_path, 5, 3, 4) == 23


def test_two_signatures_have_two_files(tmp_path: Path) -> None:
    # a sum that whole numbers of 64 bits have no room for
    assert total(tmp_path, 2, 2**62, 2**62) == -(2**62)
    (index,) = kept(tmp_path, ".nbi")
    of_whole_numbers = index.read_bytes()
    index.unlink()
    # as by two processes at once, each of which saw an empty cache
    assert total(tmp_path, 2, 2.0**62, 2.0**62) == 3 * 2**62
    index.write_bytes(of_whole_numbers)
    assert total(tmp_path, 2, 2**62, 2**62) == -(2**62)

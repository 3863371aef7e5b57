"""The arrows of the house: who may import whom, and what a light import may cost."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ALLOWED = {
    "equigrasp/cli": {"equigrasp", "tasks", "equivariance_tests"},
    "equigrasp": {"equigrasp"},
    "tasks": {
        "equigrasp.grasp",
        "equigrasp.hand",
        "equigrasp.workspace",
        "equigrasp.heightmap",
        "equigrasp.errors",
        "equigrasp.artefacts",
        "equigrasp.naming",
        "tasks",
    },
    "equivariance_tests": {"equigrasp", "equivariance_tests"},
}
"""Longest folder first: what of ours each may import."""
FORBIDDEN = {"equigrasp": {"pybullet", "gymnasium"}, "tasks": {"torch", "escnn", "transformers"}}


def imports(path: Path) -> set[str]:
    """Every module that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            ours = node.module.split(".")[0] in {"equigrasp", "tasks", "equivariance_tests"}
            # `from equigrasp import fields` names a module or a record; either is within the package
            found |= {f"{node.module}.{alias.name}" for alias in node.names} if ours else {node.module}
    return found


def violations(folder: str, names: set[str]) -> set[str]:
    ours = {name for name in names if name.split(".")[0] in {"equigrasp", "tasks", "equivariance_tests", "tests"}}
    allowed = ALLOWED[folder]
    wrong = {name for name in ours if not any(name == each or name.startswith(each + ".") for each in allowed)}
    return wrong | {name for name in names if name.split(".")[0] in FORBIDDEN.get(folder.split("/")[0], set())}


def modules() -> list[tuple[str, Path]]:
    return [
        (next(folder for folder in ALLOWED if str(path.relative_to(ROOT)).startswith(folder + "/")), path)
        for package in ("equigrasp", "tasks", "equivariance_tests")
        for path in sorted((ROOT / package).rglob("*.py"))
    ]


@pytest.mark.parametrize(("folder", "path"), modules(), ids=lambda value: getattr(value, "stem", str(value)))
def test_imports_run_one_way(folder: str, path: Path) -> None:
    assert not violations(folder, imports(path))


def test_a_wrong_arrow_is_noticed(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.py"
    wrong.write_text("def f():\n    from tasks.env import GraspEnv\n    import pybullet\n")
    assert violations("equigrasp", imports(wrong)) == {"tasks.env.GraspEnv", "pybullet"}
    wrong.write_text("import torch\nfrom equigrasp.policy import GraspPolicy\n")
    assert violations("tasks", imports(wrong)) == {"torch", "equigrasp.policy.GraspPolicy"}


@pytest.mark.parametrize(
    "module",
    [
        "equigrasp",
        "equigrasp.models",
        "equigrasp.cli",
        "equigrasp.demonstrations",
        "tasks",
        "equivariance_tests.plugin",
    ],
)
def test_a_light_import_costs_no_torch(module: str) -> None:
    heavy = {"torch", "escnn", "pybullet", "transformers", "ray", "minari", "pyarrow"}
    code = f"import sys, {module}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

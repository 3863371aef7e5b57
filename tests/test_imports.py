"""The arrows of the house: who may import whom, and what a light import may cost."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).parent.parent
ALLOWED = {
    "equigrasp/cli": {"equigrasp", "tasks", "equivariance_tests"},
    "equigrasp": {"equigrasp"},
    "tasks": {
        "equigrasp.compiled",
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
    return _named(ast.walk(ast.parse(path.read_text())))


def runs(path: Path) -> set[str]:
    """Every module that running a file imports: not those under TYPE_CHECKING, which are for readers of types."""
    tree = ast.parse(path.read_text())
    types = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    for node in types:
        tree.body.remove(node)
    return _named(ast.walk(tree))


def _named(nodes: Iterable[ast.AST]) -> set[str]:
    found = set()
    for node in nodes:
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


def itself(name: str) -> str:
    return name


def folder(name: str) -> str:
    """A module's folder within its package; the module, if it stands beside the folders."""
    parts = name.split(".")
    return ".".join(parts[:2]) if len(parts) > 2 else name


def circles(root: Path, packages: tuple[str, ...], room: Callable[[str], str] = itself) -> list[set[str]]:
    """Rooms (modules, or folders) that import each other, directly or through others, at any time."""
    paths = sorted(path for package in packages for path in (root / package).rglob("*.py"))
    names = [".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__") for path in paths]
    rooms = sorted({room(name) for name in names})
    place = {name: rooms.index(room(name)) for name in names}
    arrows = np.zeros((len(rooms), len(rooms)), dtype=bool)
    for path, name in zip(paths, names, strict=True):
        for each in runs(path):
            # a record of a module, or the module itself
            target = each if each in place else each.rpartition(".")[0]
            if target in place and place[target] != place[name]:
                arrows[place[name], place[target]] = True
    count, label = connected_components(arrows, connection="strong")
    found = [{name for name, each in zip(rooms, label, strict=True) if each == index} for index in range(count)]
    return [each for each in found if len(each) > 1]


@pytest.mark.parametrize("room", [itself, folder])
def test_no_rooms_import_each_other(room: Callable[[str], str]) -> None:
    # a policy loads itself: `GraspPolicy.from_pretrained`, as the hub's models have it, builds what composition makes
    known = {room(f"equigrasp.{name}") for name in ("policy", "sharing.shareable", "models", "composition")}
    assert circles(ROOT, ("equigrasp", "tasks", "equivariance_tests"), room) == [known]


def test_a_circle_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks" / "one.py").write_text("from tasks.other import f\n")
    (tmp_path / "tasks" / "other.py").write_text("def f():\n    import tasks.third\n")
    (tmp_path / "tasks" / "third.py").write_text("if TYPE_CHECKING:\n    from tasks import one\n")
    assert circles(tmp_path, ("tasks",)) == []
    (tmp_path / "tasks" / "third.py").write_text("def g():\n    from tasks import one\n")
    assert circles(tmp_path, ("tasks",)) == [{"tasks.one", "tasks.other", "tasks.third"}]


def test_a_circle_of_folders_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "tasks" / "objects").mkdir(parents=True)
    (tmp_path / "tasks" / "objects" / "mesh.py").write_text("import tasks.oracle\n")
    (tmp_path / "tasks" / "objects" / "shape.py").write_text("")
    (tmp_path / "tasks" / "oracle.py").write_text("from tasks.objects.shape import Shape\n")
    assert circles(tmp_path, ("tasks",)) == []
    assert circles(tmp_path, ("tasks",), folder) == [{"tasks.objects", "tasks.oracle"}]


@pytest.mark.parametrize(
    "module",
    [
        "equigrasp",
        "equigrasp.models",
        "equigrasp.cli",
        "equigrasp.demonstrations",
        "equigrasp.augmentation",
        "equigrasp.engines",
        "tasks",
        "equivariance_tests.plugin",
    ],
)
def test_a_light_import_costs_no_torch(module: str) -> None:
    heavy = {"torch", "escnn", "pybullet", "transformers", "ray", "minari", "pyarrow"}
    code = f"import sys, {module}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("module", ["equigrasp", "equigrasp.cli"])
def test_a_version_and_a_help_cost_not_even_numpy(module: str) -> None:
    """Of a third of a second that numpy takes where the disk is slow."""
    code = f"import sys, {module}; equigrasp.__version__; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_every_name_of_the_package_is_there_and_no_other() -> None:
    code = "import equigrasp; print(all(getattr(equigrasp, name) for name in equigrasp.__all__)); equigrasp.Grsp"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "True"
    assert "has no attribute 'Grsp'" in done.stderr


@pytest.mark.parametrize("module", ["torch._dynamo", "scipy.stats", "sklearn", "transformers", "matplotlib"])
def test_who_acts_does_not_wait_for_what_it_never_calls(module: str) -> None:
    """Torch's compiler takes longer to import than torch itself, the two that escnn asks for a quarter of a start."""
    code = f"import sys, equigrasp.training, equivariance_tests.wrapping; print('{module}' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"

"""What is imported late is there when it is called, and is nobody else's business."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from equigrasp.late import Late, late

SPY = """print("imported")
def double(number, *, more=0): return 2 * number + more
class Of: triple = staticmethod(lambda number: 3 * number)
"""
ASKING = "from shelf import spy\nfrom shelf.spy import double\nimport shelf.spy\n"


def told(folder: Path, code: str) -> list[str]:
    """What a process prints that finds a package `shelf` with a module `spy`, and one that asks for it."""
    (folder / "shelf").mkdir(exist_ok=True)
    (folder / "shelf" / "__init__.py").write_text(
        "import importlib\ndef __getattr__(name): return importlib.import_module('shelf.' + name)\n"
    )
    (folder / "shelf" / "spy.py").write_text(SPY)
    (folder / "asking.py").write_text(ASKING)
    code = f"import sys; sys.path.insert(0, {str(folder)!r}); from equigrasp.late import late\n{code}"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_a_late_module_is_imported_by_its_first_call(tmp_path: Path) -> None:
    code = """
with late("shelf.spy"):
    import asking
print("asked")
print(asking.double(4, more=1), asking.spy.Of.triple(5), asking.spy.double(6))
"""
    assert told(tmp_path, code) == ["asked", "imported", "9", "15", "12"]


def test_a_late_name_can_be_called_before_the_others_are_there(tmp_path: Path) -> None:
    code = """
with late("shelf", "shelf.spy"):
    import asking
    print("asked")
    print(asking.double(4))
print(asking.spy.Of.triple(5))
"""
    assert told(tmp_path, code) == ["asked", "imported", "8", "15"]


def test_who_asks_whether_a_late_package_is_installed_hears_it_is(tmp_path: Path) -> None:
    code = """
import importlib.util
with late("shelf", "shelf.spy"):
    print(importlib.util.find_spec("shelf").origin)
"""
    assert told(tmp_path, code) == [str(tmp_path / "shelf" / "__init__.py")]


def test_afterwards_an_import_is_an_import(tmp_path: Path) -> None:
    code = """
with late("shelf.spy"):
    import asking
import shelf.spy
print(shelf.spy.double(1), sys.modules["shelf.spy"].__file__ is not None)
"""
    assert told(tmp_path, code) == ["imported", "2", "True"]


def test_what_is_there_already_stays(tmp_path: Path) -> None:
    code = """
import shelf.spy
with late("shelf.spy"):
    import asking
print(asking.double is shelf.spy.double)
"""
    assert told(tmp_path, code) == ["imported", "True"]


def test_what_is_not_installed_is_missed_at_once() -> None:
    with late("no_such_package.module"), pytest.raises(ModuleNotFoundError, match="no_such_package"):
        __import__("no_such_package.module")


def test_an_import_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    code = """
try:
    with late("shelf.spy"):
        raise RuntimeError
except RuntimeError:
    print("shelf.spy" in sys.modules)
"""
    assert told(tmp_path, code) == ["False"]


def test_what_a_late_name_has_not_is_missed_when_it_is_called() -> None:
    with pytest.raises(AttributeError, match="no_such_root"):
        Late("math").no_such_root(2)


def test_escnn_finds_what_it_asked_for() -> None:
    """Its initialisation by orthogonal matrices, null spaces of its sparse matrices, and its search in a span."""
    code = """
from equigrasp import fields
import escnn.nn.init, escnn.group._numerical, numpy
matrix = escnn.nn.init.stats.ortho_group.rvs(3)
print(numpy.allclose(matrix @ matrix.T, numpy.eye(3)))
print(numpy.allclose(escnn.group._numerical.randomized_svd(numpy.eye(3), n_components=2, random_state=0)[1], 1))
import scipy.stats
print(scipy.stats.norm.cdf(0.0))
turn = numpy.array([[0.0, -1.0], [1.0, 0.0]])
found = escnn.group._numerical.find_orthogonal_matrix(2 * turn.reshape(-1, 1, order="F"), (2, 2))[0]
print(numpy.allclose(abs(found), abs(turn)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "0.5", "True"]


def test_a_policy_is_built_by_a_python_that_drops_docstrings() -> None:
    """Which pymanopt cannot be imported by."""
    code = """
from dataclasses import replace
from equigrasp import models
small = {"kernel_size": 17, "maximum_frequency": 4, "channels": 4, "widths": (8, 8, 16, 16, 16)}
print(type(models.build(replace(models.MODELS["leg-steerable"], text_encoder="hashing", **small))).__name__)
"""
    done = subprocess.run([sys.executable, "-OO", "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["LegPolicy"], done.stderr


def test_clip_is_there_without_the_towers_that_it_does_not_have() -> None:
    """And with open_clip's own classes, which find them when they are asked for them."""
    code = """
import sys
from equigrasp import clip
clip.tokenizer("clip-rn50")
print([name for name in clip.ELSEWHERE if name in sys.modules])
import open_clip, torch, torchvision
print(open_clip.timm_model.timm.create_model("resnet10t").num_classes)
print(tuple(torchvision.ops.roi_align(torch.rand(1, 3, 8, 8), torch.tensor([[0.0, 0, 0, 4, 4]]), 2).shape))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "1000", "(1, 3, 2, 2)"]

"""A user's own policy, docs/my_policy.py as it stands: trained, found again, measured, saved, like one of ours."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch
from torch import nn

from equigrasp import language, models
from equigrasp.cli import main
from equigrasp.config import FcgqConfig, ModelConfig, OwnConfig
from equigrasp.encoder import UNet
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.kernel import SteerableKernel
from equigrasp.plan import PLAN
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy
from equigrasp.training import load_policy

DOCS = Path(__file__).parent.parent / "docs"


@pytest.fixture
def my_policy(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """In the folder where my_policy.py is, and not imported yet."""
    monkeypatch.chdir(DOCS)
    monkeypatch.syspath_prepend(DOCS)
    monkeypatch.delitem(sys.modules, "my_policy", raising=False)
    yield
    sys.modules.pop("my_policy", None)


@pytest.fixture
def run(my_policy: None, tmp_path: Path, data: Path) -> Path:
    out = tmp_path / "run"
    options = ["--steps", "5", "--threads", "1", "--text-encoder", "hashing", "--out", str(out)]
    main(["train", "--model", "my_policy:MY_MODEL", "--data", str(data), *options])
    sys.modules.pop("my_policy")
    return out


def test_it_is_trained_found_again_and_acts(run: Path, tmp_path: Path, demonstrations: list[Demonstration]) -> None:
    recorded = json.loads((run / PLAN).read_text())["model"]
    assert (recorded["family"], recorded["name"]) == ("my_policy:FcnConfig", "my-fcn")
    policy = load_policy(run)
    assert policy.config is not None
    each = demonstrations[0]
    grasp = policy.act(each.observation, each.instruction)
    fresh = models.build(policy.config, seed=0)
    assert not torch.equal(policy.state_dict()["network.score.bias"], fresh.state_dict()["network.score.bias"])

    main(["evaluate", "--run", str(run), "--protocol", "single-shot", "--scenes", "1", "--threads", "1"])
    [evaluation] = (run / "evaluations").glob("*.json")
    assert json.loads(evaluation.read_text())["policy"]["rates"]["correct"]["trials"] == 1

    main(["share", "--run", str(run), "--out", str(tmp_path / "shared")])
    sys.modules.pop("my_policy")
    assert GraspPolicy.from_pretrained(tmp_path / "shared").act(each.observation, each.instruction) == grasp


def test_a_run_whose_module_is_gone_is_one_sentence(run: Path, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [each for each in sys.path if Path(each or ".").resolve() != DOCS])
    with pytest.raises(InputError, match=r"'my_policy' cannot be imported .*in this folder\?"):
        load_policy(run)


def test_its_settings_survive_json_and_make_variants(my_policy: None) -> None:
    row = models.find("my_policy:MY_MODEL")
    variant = replace(row, dilations=(1, 2), text_encoder="hashing")
    assert ModelConfig.from_dict(json.loads(json.dumps(variant.to_dict()))) == variant
    assert "network.see.2.weight" not in models.build(variant).state_dict()
    one, again, other = (models.build(variant, seed).state_dict()["network.stem.weight"] for seed in (1, 1, 2))
    assert torch.equal(one, again)
    assert not torch.equal(one, other)


def test_the_laws_say_what_it_lacks(my_policy: None, tmp_path: Path) -> None:
    """As docs/my_policy.md says: it moves with the scene and does not turn with it."""
    from equivariance_tests import check_equivariance
    from equivariance_tests.wrapping import load_by_name

    report = check_equivariance(load_by_name("my_policy:make"), ["policy: translation", "policy: quarter turn"])
    assert [finding.status for finding in report.findings] == ["holds", "fails"]


# Configs that cannot be


def not_a_config() -> None: ...


@dataclass(frozen=True, kw_only=True)
class Unregistered(ModelConfig):
    family = "leg"


@dataclass(frozen=True, kw_only=True)
class Builds(OwnConfig):
    what: str

    def build(self) -> Any:
        return {"nothing": None, "a module": nn.Linear(1, 1), "a deaf one": _deaf()}[self.what]


def _deaf() -> DensePolicy:
    return DensePolicy(UNet(384, 36, 2, (8, 8, 16, 16, 16)), "minilm")


@dataclass(frozen=True, kw_only=True)
class Holds(OwnConfig):
    setting: Any = ()

    def build(self) -> DensePolicy:
        return DensePolicy(UNet(language.width(self.encoder), 36, 2, (8,) * 5), self.encoder, self.precision)


@dataclass(frozen=True, kw_only=True)
class OwnLeg(OwnConfig):
    def build(self) -> LegPolicy:
        size = language.width(self.encoder)
        phi, kappa = UNet(size, 4, 2, (8,) * 5), SteerableKernel(size, 4, 17, 4)
        return LegPolicy(phi, kappa, self.encoder, self.precision)


@dataclass(frozen=True, kw_only=True)
class OwnFcgq(OwnConfig, FcgqConfig):
    def build(self) -> DensePolicy:
        return DensePolicy(UNet(language.width(self.encoder), 36, 2, self.widths), self.encoder, self.precision)


def hidden() -> type[Builds]:
    @dataclass(frozen=True, kw_only=True)
    class Hidden(Builds):
        pass

    return Hidden


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (not_a_config, "is a function, but a model is named by its config"),
        (Unregistered(name="x", summary=""), "of the family leg, which is another class"),
        (hidden()(name="x", summary="", what="nothing"), "there is no name in"),
    ],
)
def test_what_is_no_config_is_one_sentence(value: Any, sentence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("somebodys")
    monkeypatch.setattr(module, "MY_MODEL", value, raising=False)
    monkeypatch.setitem(sys.modules, "somebodys", module)
    with pytest.raises(InputError, match=sentence):
        models.find("somebodys:MY_MODEL")


@pytest.mark.parametrize("name", ["nowhere_at_all:MY_MODEL", "my_policy:MY_MODLE", "my_policy:"])
def test_a_wrong_name_is_one_sentence_and_writes_nothing(
    name: str, my_policy: None, data: Path, tmp_path: Path, capsys: Any
) -> None:
    with pytest.raises(SystemExit):
        main(["train", "--model", name, "--data", str(data), "--out", str(tmp_path / "run")])
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert any(way in errors[0] for way in ("is it installed", "did you mean 'MY_MODEL'", "is given as"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("what", ["nothing", "a module", "a deaf one"])
def test_a_build_that_gives_no_policy_on_its_encoder_is_one_sentence(what: str) -> None:
    with pytest.raises(InputError, match=r"builds '(NoneType|Linear|minilm)', but it must build a GraspPolicy on"):
        models.build(Builds(name="x", summary="", what=what, text_encoder="hashing"))


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ([8, 8], r"has setting=\[8, 8\], which a file gives back as \(8, 8\); settings are numbers, strings"),
        (((1, 2), (3, 4)), r"which a file gives back as \(\[1, 2\], \[3, 4\]\)"),
        ({32: 8}, r"which a file gives back as \{'32': 8\}"),
        (float("nan"), "which a file gives back as nan"),
        (Path("here"), r"cannot be recorded as JSON \(Object of type \w*Path .*; settings are numbers"),
    ],
    ids=["a list", "nested tuples", "numbers as keys", "not a number", "a path"],
)
def test_a_setting_that_a_file_would_change_is_one_sentence_before_any_work(setting: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        models.build(Holds(name="x", summary="", text_encoder="hashing", setting=setting))


@pytest.mark.parametrize("setting", [3, 0.1, "a", None, True, (1, 2.5, "b"), {"32": 8}])
def test_a_setting_that_json_has_is_saved_and_found_again(setting: Any, tmp_path: Path) -> None:
    policy = models.build(Holds(name="x", summary="", text_encoder="hashing", setting=setting))
    policy.save_pretrained(tmp_path)
    assert GraspPolicy.from_pretrained(tmp_path).config == policy.config


def test_a_class_inside_a_function_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"hidden.<locals>.Hidden is defined inside a function"):
        models.build(hidden()(name="x", summary="", what="a module", text_encoder="hashing"))


def test_a_class_of_the_script_that_runs_is_built_and_measured_but_not_saved(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    code = (DOCS / "my_policy.py").read_text() + (
        "\n\nfrom equivariance_tests import check_equivariance\n"
        "print([each.status for each in check_equivariance(make(), ['policy: translation']).findings])\n"
        "try: make().save_pretrained('saved')\n"
        "except ValueError as error: print(error)\n"
    )
    script.write_text(code)
    said = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path, check=False)
    measured, refused = said.stdout.splitlines()
    assert measured == "['holds']", said.stderr
    assert "__main__:FcnConfig is a class of the script that runs" in refused
    assert [each.name for each in tmp_path.iterdir()] == ["script.py"]


def test_a_stride_that_the_policy_has_not_is_one_sentence() -> None:
    config = OwnFcgq(name="x", summary="", text_encoder="hashing", widths=(8,) * 5)
    assert models.build(config).stride == 2
    with pytest.raises(InputError, match="x has stride 1, but the policy that it builds has 2"):
        models.build(replace(config, stride=1))


def test_the_parameters_of_a_leg_of_ones_own_are_counted() -> None:
    config = OwnLeg(name="x", summary="", text_encoder="hashing")
    trainable = sum(each.numel() for each in models.build(config).parameters() if each.requires_grad)
    assert models.count_parameters(config)[0] == trainable > 0


def test_the_page_runs_the_file() -> None:
    """What docs/my_policy.md quotes is what docs/my_policy.py says."""
    code = (DOCS / "my_policy.md").read_text().split("```python\n")[1].split("```")[0]
    assert code.strip() in (DOCS / "my_policy.py").read_text()

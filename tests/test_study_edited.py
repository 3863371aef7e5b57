"""A network of one's own that is edited while its study runs: a line says the code that ran, or there is no line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from equigrasp import engines
from equigrasp.artefacts import checksum
from equigrasp.cli.study import Study
from equigrasp.config import ModelConfig
from equigrasp.engines.worker import working
from equigrasp.errors import InputError
from equigrasp.models import find
from equigrasp.study.cost import measure
from equigrasp.study.matrix import CostJob, Job, Matrix
from equigrasp.study.results import known_by
from equigrasp.study.work import Telling, Work

DOCS = Path(__file__).parent.parent / "docs"
ROW = "\nimport dataclasses\nTINY = dataclasses.replace(MY_MODEL, name='tiny', width=8, dilations=(1,))\n"
TWO_THINGS = (
    "from tasks import Goal, Task\n"
    "PICK = Task('pick-two', 'mine/Two-v0', (Goal('fork'), Goal('mug')), objects=(2, 2))\n"
)


@pytest.fixture
def tiny(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A module of a user's: docs/my_policy.py with a smaller row more."""
    path = tmp_path / "edited_models.py"
    path.write_text((DOCS / "my_policy.py").read_text() + ROW)
    (tmp_path / "two_things.py").write_text(TWO_THINGS)
    monkeypatch.syspath_prepend(tmp_path)
    yield path
    for module in ("edited_models", "two_things"):
        sys.modules.pop(module, None)


def edit(module: Path) -> None:
    before = module.read_text()
    module.write_text(before.replace("functional.relu(", "3 * functional.relu("))
    assert module.read_text() != before


def code_of(module: Path) -> str:
    return f"sha256:{checksum(module.read_bytes())[:16]}"


def job_of(model: ModelConfig) -> Job:
    (job,) = Matrix((model,), ("pick-logo",), (1,), (0,), (6,), camera="overhead").jobs()
    return job


def study_of(out: Path) -> Study:
    return Study(
        models=("edited_models:TINY",),
        tasks=("two_things:PICK",),
        demos=(1,),
        seeds=(0,),
        steps=(2,),
        scenes=0,
        queries=1,
        turned=0,
        camera="overhead",
        text_encoder="hashing",
        out=out,
    )


@dataclass(frozen=True)
class Editing:
    """The local engine, for a user who saves his file when the demonstrations are there and the work begins."""

    module: Path
    workers: int | None = None
    address: str | None = None

    def __call__(self, work: Callable[[Any], Any], items: Sequence[Any]) -> Generator[tuple[Any, Any]]:
        if isinstance(work, Telling):
            edit(self.module)
        return engines.Local(self.workers)(work, items)


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_line_says_the_code_that_ran_and_the_edited_network_is_run_next(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = code_of(tiny)
    study = study_of(tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setitem(engines.ENGINES, "local", lambda workers, address: Editing(tiny, workers, address))
        results = study.execute()
    after = code_of(tiny)
    assert [line["config"]["code"] for line in lines(results)] == [before] != [after]
    sys.modules.pop("edited_models")  # as another process begins
    replace(study).execute()
    assert [line["config"]["code"] for line in lines(results)] == [before, after]
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 2


def test_a_job_is_known_by_the_code_that_was_there_when_the_class_was_made(tiny: Path) -> None:
    model = find("edited_models:TINY")
    before = code_of(tiny)
    edit(tiny)
    job = job_of(model)  # the class in memory is still the old one
    assert job.cell("pick-logo")["config"]["code"] == CostJob(model, 1).cell()["config"]["code"] == before


def test_a_worker_that_finds_the_file_edited_refuses_the_job_and_begins_nothing(tiny: Path, tmp_path: Path) -> None:
    """A process of its own imports the module with its first job, which may be long after the study began."""
    job = job_of(replace(find("edited_models:TINY"), text_encoder="hashing"))
    known, run = known_by(job.cell("pick-logo")), job.run
    edit(tiny)
    work = Telling(Work(tmp_path / "study", _no_env, {"pick-logo": 1}, _no_symmetry))
    with working(work, 1) as (worker,):
        worker.ask(job)
        found, said = worker.answer()
    assert found == []
    assert said is not None
    assert "tiny was edited since this study began: its code is 'sha256:" in said
    assert "run the study again" in said
    assert "\n" not in said
    assert not (tmp_path / "study").exists()
    assert (known_by(job.cell("pick-logo")), job.run) == (known, run)


def test_the_cost_of_an_edited_network_is_not_the_old_ones(tiny: Path) -> None:
    model = replace(find("edited_models:TINY"), text_encoder="hashing")
    job = CostJob(model, threads=1, timed=1)
    (line,) = measure(job)
    assert line["config"]["code"] == code_of(tiny)
    edit(tiny)
    with pytest.raises(InputError, match="tiny was edited since this study began"):
        measure(job)


def _no_env(*_: Any) -> Any:
    raise AssertionError("a simulator was started")


def _no_symmetry(*_: Any) -> Any:
    raise AssertionError("something was measured")

"""The laws of symmetry as a command: a verdict for each law, a picture, a JSON file beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equigrasp.cli.common import Camera, bar, camera_of, make_env, say, task_of
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equivariance_tests.simulator import Follow
    from tasks.env import GraspEnv


@dataclass
class Equivariance:
    """Does the best grasp turn with the object? Measure every law on a trained policy, or on a module of yours.

    Exits with 1 if a law fails that was not expected to.

    Example: equigrasp equivariance --run runs/my-run --simulate 20
    """

    run: Path | None = None
    """A run folder that `equigrasp train` made."""
    policy: str | None = None
    """my_package.my_module:make, which gives a kernel or a policy of yours; instead of --run."""
    expect: dict[str, str] = field(default_factory=dict)
    """Laws that it is known to break, each with the reason: --expect "lemma 1" "C_90 has no quarter turn"."""
    scenes: int = 50
    """Scenes in which the picture counts how far the best grasp lands; 200 take a few minutes."""
    simulate: int = 0
    """Scenes in the simulator, where the target alone is turned; with --run."""
    step: int | None = None
    """A step whose weights were kept [default: the last]; with --run."""
    camera: Camera | None = None
    """Cameras of the simulated scenes [default: those it was trained with]."""
    mutants: bool = False
    """Also measure the broken kernels and policies that the laws are tested with, as a table."""
    seed: int = 0
    """Of group elements, scenes and embeddings, from 0 to 999."""
    out: Path | None = None
    """Folder of the report [default: in the run folder, or equivariance/]."""

    def execute(self) -> None:
        """Measure, print, draw, write."""
        if (self.run is None) == (self.policy is None):
            raise InputError("give either --run DIR or --policy my_package.my_module:make, and not both")
        if self.step is not None and self.run is None:
            raise InputError(f"--step is {self.step}, but only a --run has weights of steps; leave it out")
        if self.scenes < 1:
            raise InputError(f"--scenes is {self.scenes}, but it must be at least 1")
        if self.simulate < 0 or (self.simulate and self.run is None):
            raise InputError(f"--simulate is {self.simulate}, but it takes at least 0 scenes and a --run to simulate")
        from equigrasp.collection import check_seed

        check_seed(self.seed)
        plan = step = None
        if self.run is not None:
            from equigrasp.plan import read_plan, step_of

            plan = read_plan(self.run)
            step = step_of(plan, self.step)
        make_its_env = self._simulated(plan) if self.simulate and plan is not None else None
        module = self._module()
        from equigrasp.sharing.measured import report_folder

        out = self.out or (Path("equivariance") if self.run is None else report_folder(self.run, self.step))
        from equigrasp.artefacts import check_folder, write_json

        check_folder(out, "--out")
        from equivariance_tests.check import check_equivariance
        from equivariance_tests.comparison import comparison, error_against_angle, errors_of_eq_2
        from equivariance_tests.figures import draw
        from equivariance_tests.subjects import KernelSubject
        from equivariance_tests.wrapping import subjects_of

        report = check_equivariance(module, expected_failures=self.expect, seed=self.seed, progress=bar("laws", "laws"))
        if plan is not None:
            report = replace(report, name=f"{module.config.name}, {step:,} steps")
        say(str(report))
        subjects = comparison(self.seed)
        own = [each for each in subjects_of(module) if isinstance(each, KernelSubject)]
        subjects.update((report.name, each) for each in own)
        curves = error_against_angle(subjects, progress=bar("error by angle", "kernels"))
        readable = {name: each for name, each in subjects.items() if each.read_out is not None}
        landings = errors_of_eq_2(readable, self.scenes, self.seed, bar("best grasps", "kernels"))
        results: dict[str, Any] = {
            "report": report.to_dict(),
            "error against angle": curves,
            "errors of eq. 2": landings,
            "seed": self.seed,
            "run": plan,
            "step": step,
        }
        say(*_shares(landings))
        if make_its_env is not None:
            follow = self._simulate(module, make_its_env())
            say("in the simulator, the target alone turned:", *(f"    {line}" for line in follow.lines()))
            results["simulator"] = follow.to_dict()
        out.mkdir(parents=True, exist_ok=True)
        draw(
            report, curves, {name: each["eq. 2, any turn"] for name, each in landings.items()}, out / "equivariance.png"
        )
        if self.mutants:
            results["mutants"] = _mutants(out)
        write_json(out / "equivariance.json", _finite(results))
        say(f"the picture is {out / 'equivariance.png'}, the figures are in {out / 'equivariance.json'}")
        if not report.passed:
            raise SystemExit(1)

    def _module(self) -> Any:
        if self.run is not None:
            from equigrasp.plan import find_weights

            find_weights(self.run, self.step)
            from equigrasp.training import load_policy

            return load_policy(self.run, self.step)
        from equivariance_tests.wrapping import load_by_name

        assert self.policy is not None
        return load_by_name(self.policy)

    def _simulated(self, plan: dict[str, Any]) -> Callable[[], GraspEnv]:
        """Makes the environment of the run's task; that there is none is said before work starts."""
        task = task_of(plan, None, "leave --simulate out")
        return partial(make_env, task, camera_of(plan, self.camera))

    def _simulate(self, policy: Any, env: GraspEnv) -> Follow:
        from equivariance_tests.simulator import proposition_1

        try:
            return proposition_1(policy.act, env, self.simulate, self.seed, bar("simulated", "scenes"))
        finally:
            env.close()


def _shares(landings: dict[str, dict[str, list[float]]]) -> list[str]:
    from equivariance_tests.laws import LAWS

    lines = ["Eq. 2 with phi = identity, scenes in which the best grasp follows:"]
    for name, laws in landings.items():
        for law, errors in laws.items():
            if not errors:
                lines.append(f"    {name}: no scene could be measured ({law})")
                continue
            tolerance = max(LAWS[law].tolerance.values())
            within = sum(error <= tolerance for error in errors)
            lines.append(f"    {name}: {within} of {len(errors)} within {tolerance:g} ({law}), worst {max(errors):.2f}")
    return lines


def _mutants(out: Path) -> dict[str, Any]:
    from equigrasp.artefacts import write_atomically
    from equivariance_tests.mutation import as_markdown, mutation_table

    table = mutation_table(progress=bar("mutants", "mutants"))
    write_atomically(out / "mutants.md", as_markdown(table).encode())
    say(f"the table of mutants and laws is {out / 'mutants.md'}")
    return {mutant: {law: verdict.to_dict() for law, verdict in row.items()} for mutant, row in table.items()}


def _finite(value: Any) -> Any:
    """The value with None for each number that JSON does not have."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and (value != value or abs(value) == float("inf")) else value

"""The command that makes of a run what others load: weights, config and a card, in one folder, and on the hub."""

from __future__ import annotations

import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from equigrasp.cli.common import options, say
from equigrasp.errors import InputError


@dataclass
class Share:
    """Make a folder that others load a trained policy from, with a card of what was measured; and push it.

    The card has what `equigrasp evaluate`, `equigrasp study` and `equigrasp equivariance` left in the run folder of
    these weights: measure first.

    Example: equigrasp share --run runs/my-run --out shared/my-run --push my-name/my-policy
    """

    run: Path
    """A run folder that `equigrasp train` made and finished."""
    out: Path
    """The new folder."""
    step: int | None = None
    """A step whose weights were kept [default: the last]."""
    push: str | None = None
    """Upload it to the Hugging Face hub, as a model of this id."""
    private: bool = False
    """With --push: a model that is made is private."""
    equivariance: Path | None = None
    """The report for the card [default: the one on these weights in the run folder, if there is one]."""
    license: str = "mit"
    """The weights' licence, as the hub abbreviates it."""

    def execute(self) -> None:
        """Check everything, write the folder whole, upload it."""
        from equigrasp.artefacts import check_folder, partial_name, remove_partials_of
        from equigrasp.hub import check_can_push

        if self.equivariance is not None and not self.equivariance.is_file():
            raise InputError(f"there is no report {self.equivariance}; make one with `equigrasp equivariance`")
        if self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())):
            raise InputError(f"{self.out} exists and is no empty folder; choose another --out")
        check_folder(self.out, "--out")
        if self.push is not None:
            check_can_push(self.push)
        from equigrasp.plan import find_weights, read_plan, step_of

        plan = read_plan(self.run)
        find_weights(self.run, self.step)
        from equigrasp.sharing.measured import read_evaluations, read_laws, report_folder
        from equigrasp.sharing.shareable import portable
        from equigrasp.training import load_policy

        step = step_of(plan, self.step)
        measured = read_evaluations(self.run, plan)
        evaluations = [each for each in measured if each.step == step]
        report = self.equivariance or report_folder(self.run, self.step) / "equivariance.json"
        laws = read_laws(report, plan, step)
        policy = load_policy(self.run, self.step)
        assert policy.config is not None
        policy.config = portable(policy.config)
        where = self.push or self.out.name
        card = {"evaluations": evaluations, "laws": laws, "license": self.license, "where": where}
        self.out.parent.mkdir(parents=True, exist_ok=True)
        remove_partials_of(self.out)
        partial = partial_name(self.out)
        try:
            policy.save_pretrained(partial, model_card_kwargs=card)
            partial.replace(self.out)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        same, out = options(run=self.run, step=self.step), shlex.quote(str(self.out))
        say(f"{self.out} has the policy, and README.md says what is known of it")
        if not evaluations:
            say(f"its success was not measured; `equigrasp evaluate{same}` does, then share it again")
        for other in sorted({each.step for each in measured} - {step}):
            way = "without --step they are shared" if other == step_of(plan) else f"--step {other} shares them"
            say(f"the weights of step {other} were measured, too; {way}")
        if not laws:
            say(f"its symmetry was not measured; `equigrasp equivariance{same}` does, then share it again")
        if self.push is None:
            say(f"next: equigrasp evaluate --run {out}, or `hf upload USER/NAME {out}`")
        else:
            say(policy.push_to_hub(self.push, private=self.private or None, model_card_kwargs=card))

"""The command that makes of a run one file for a robot that has neither equigrasp nor escnn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from equigrasp.cli.common import say
from equigrasp.errors import InputError


@dataclass
class Export:
    """Write a trained policy as one program, of torch.export (.pt2) or ONNX (.onnx), and say how well it agrees.

    It takes an observation and an instruction's embedding, and gives the log-probabilities (`docs/export.md`).

    Example: equigrasp export --run runs/my-run --out my-policy.onnx
    """

    run: Path
    """A run folder that `equigrasp train` made, or a folder of `equigrasp share`."""
    out: Path
    """The new file; its name says the format, .pt2 or .onnx."""
    step: int | None = None
    """A step whose weights were kept [default: the last]."""

    def execute(self) -> None:
        """Check, export, compare, write."""
        from equigrasp.artefacts import check_folder

        if self.out.suffix not in (".pt2", ".onnx"):
            raise InputError(f"--out is {self.out}, but its name must end in .pt2 or .onnx, which says the format")
        if self.out.exists():
            raise InputError(f"{self.out} exists; choose another --out")
        check_folder(self.out.parent, "--out")
        from equigrasp.plan import find_weights

        find_weights(self.run, self.step)
        from equigrasp.export import export, writer
        from equigrasp.training import load_policy

        writer(self.out)
        policy = load_policy(self.run, self.step)
        agreement = export(policy, self.out)
        say(
            f"{self.out} has the policy, {self.out.stat().st_size / 1e6:.1f} MB",
            f"its log-probabilities are within {agreement.largest:.1e} of the policy's own, "
            f"which spread over {agreement.spread:.2g}",
        )

"""The command that says how hard the tasks are."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from equigrasp.cli.common import Camera, bar, say
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from tasks.difficulty import FirstTry


@dataclass
class Difficulty:
    """How hard the tasks are: what the scripted oracle lifts at its first try, and what chance does on the target.

    Example: equigrasp difficulty --tasks pick-tool pick-by-part --scenes 300 --workers 2
    """

    tasks: tuple[str, ...] = ()
    """Names of tasks [default: all of them]."""
    scenes: int = 300
    """Scenes of each task; the oracle tries every object of a scene, chance the first."""
    chance: bool = True
    """Measure chance too, or the oracle alone."""
    camera: Camera = "overhead"
    """What tells the hand how deep to go."""
    gap: float = 12.0
    """Millimetres between two objects when a scene is laid out; 3 is clutter, and 1 the least."""
    engine: Literal["local", "ray"] = "local"
    """Processes of this machine, or a Ray cluster (needs `equigrasp[ray]`)."""
    workers: int | None = None
    """Scenes at the same time [default: 1; on Ray, one for each CPU]."""
    out: Path | None = None
    """A file of JSON lines that gets one for each task and actor, with every failure."""

    def execute(self) -> None:
        """Measure, and print a table."""
        from equigrasp.artefacts import append_line, check_writable
        from equigrasp.engines import ENGINES
        from tasks import TASKS, find_task

        if self.scenes < 1:
            raise InputError(f"--scenes is {self.scenes}, but it must be at least 1")
        if not 1 <= self.gap <= 50:
            raise InputError(f"--gap is {self.gap:g}, but it must be from 1 to 50 millimetres")
        if self.out is not None:
            check_writable(self.out, "--out", lines=True)
        engine = ENGINES[self.engine](self.workers)
        rows = [find_task(name) for name in dict.fromkeys(self.tasks)] or list(TASKS.values())
        # the simulator takes its time, and greets
        from tasks.difficulty import CHANCE, ORACLE, Scenes

        pooled: dict[str, list[FirstTry]] = {}
        for task in rows:
            for actor in (ORACLE, *(CHANCE if self.chance else ())):
                with (
                    closing(Scenes(task, actor, self.camera, self.gap / 1000)) as scenes,
                    closing(engine(scenes, range(self.scenes))) as results,
                ):
                    watched = bar(task.name, "scenes")(results, self.scenes)
                    tries = [each for _, found in sorted(watched) for each in found]
                pooled.setdefault(actor, []).extend(tries)
                say(f"{task.name:19} {actor:35} {_rates(tries)}")
                if self.out is not None:
                    append_line(self.out, self._line(task.name, actor, tries))
        for actor, tries in pooled.items():
            say(f"{'all of them':19} {actor:35} {_rates(tries)}")
            reasons = Counter(each.reason for each in tries if not each.right)
            say(f"{'':19} {'':35} of {len(tries)} tries, failures: {dict(reasons) or 'none'}")

    def _line(self, task: str, actor: str, tries: list[FirstTry]) -> dict[str, Any]:
        from equigrasp.success import Rate

        lifted, right = (Rate(sum(getattr(each, what) for each in tries), len(tries)) for what in ("lifted", "right"))
        return {
            "task": task,
            "actor": actor,
            "camera": self.camera,
            "gap_mm": self.gap,
            "scenes": self.scenes,
            "tries": len(tries),
            "lifted": {"successes": lifted.successes, "interval": list(lifted.interval)},
            "right": {"successes": right.successes, "interval": list(right.interval)},
            "failures": [asdict(each) | {"quality": round(each.quality, 3)} for each in tries if not each.right]
            if actor == "oracle"
            else [],
        }


def _rates(tries: list[FirstTry]) -> str:
    from equigrasp.success import Rate

    lifted = Rate(sum(each.lifted for each in tries), len(tries))
    right = Rate(sum(each.right for each in tries), len(tries))
    return f"lifted {lifted}" + ("" if right == lifted else f", by the right part {right}")

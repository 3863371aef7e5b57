"""Commands that exchange demonstrations with Minari, the Farama Foundation's format of offline datasets."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from equigrasp.cli.common import say


@dataclass
class ExportMinari:
    """Write a data folder as a Minari dataset, one episode for each grasp, bit for bit (needs `equigrasp[minari]`).

    Datasets lie in $MINARI_DATASETS_PATH, or else in ~/.minari/datasets.

    Example: equigrasp export-minari --data data/pick-by-part-1demos-seed0 --name equigrasp/pick-by-part-v0
    """

    data: Path
    """A folder that `equigrasp collect` made."""
    name: str | None = None
    """[NAMESPACE/]NAME-vVERSION of the dataset [default: equigrasp/TASK-DEMOSdemos-seedSEED-v0]."""

    def execute(self) -> Path:
        """Export, and give the dataset's folder."""
        from equigrasp.demonstrations import load, read_collection
        from tasks.minari_dataset import check_installed, export_dataset, task_of

        check_installed()
        demonstrations, collection = load(self.data), read_collection(self.data)
        task = task_of(collection.plan())
        name = self.name or f"equigrasp/{task.name}-{collection.demos}demos-seed{collection.seed}-v0"
        folder = export_dataset(name, collection.plan(), demonstrations)
        say(f"{len(demonstrations)} episodes of {name} lie in {folder}")
        say(f"next: equigrasp import-minari --name {name} --out data/from-minari, or minari.load_dataset({name!r})")
        return folder


@dataclass
class ImportMinari:
    """Make a data folder from a Minari dataset that `equigrasp export-minari` wrote: the same demonstrations.

    Example: equigrasp import-minari --name equigrasp/pick-by-part-v0 --out data/from-minari
    """

    name: str
    """The dataset, from $MINARI_DATASETS_PATH, or else from ~/.minari/datasets."""
    out: Path
    """The data folder."""

    def execute(self) -> Path:
        """Import, and give the folder."""
        from equigrasp.collection import Collection
        from equigrasp.demonstrations import store
        from tasks.minari_dataset import import_dataset

        plan, demonstrations = import_dataset(self.name)
        store(Collection.of_plan(plan), demonstrations, self.out)
        data = shlex.quote(str(self.out))
        say(f"{len(demonstrations)} grasps lie in {self.out}", f"next: equigrasp train --data {data}")
        return self.out

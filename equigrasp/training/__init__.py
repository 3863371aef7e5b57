"""Training: `loop.py` takes the steps and keeps the run folder, `step.py` is one, `devices.py` says where it runs."""

from equigrasp.training.loop import CHECKPOINT, LOG, load_policy, train

__all__ = ["CHECKPOINT", "LOG", "load_policy", "train"]

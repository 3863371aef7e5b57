"""Training examples from demonstrations, at no cost of torch: scenes moved, put together anew, repainted, said anew."""

from equigrasp.augmentation.augmentation import Augmentation, Example

__all__ = ["Augmentation", "Example"]

"""Where work runs: in this process, in several on this machine, or on a Ray cluster; light to import."""

from equigrasp.engines.engine import ENGINES, Engine, Local, Ray

__all__ = ["ENGINES", "Engine", "Local", "Ray"]

"""phi(o, l): from an observation and an instruction to a field of features; plain, steerable, on CLIP's towers."""

from equigrasp.encoder.image import normalise
from equigrasp.encoder.local import LocalSteerableUNet
from equigrasp.encoder.steerable import SteerableUNet
from equigrasp.encoder.two_stream import TwoStream
from equigrasp.encoder.unet import UNet

__all__ = ["LocalSteerableUNet", "SteerableUNet", "TwoStream", "UNet", "normalise"]

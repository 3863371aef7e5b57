"""What LEG is compared with: networks without a kernel, and a kernel and a phi that are not told the instruction.

FCGQ is `equigrasp.encoder.UNet` with an output channel for each angle, and CLIPort's pick module `TwoStream` so.
"""

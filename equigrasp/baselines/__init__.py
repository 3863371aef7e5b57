"""What LEG is compared with: networks without a kernel, and a kernel and a phi that are not told the instruction.

FCGQ is `equigrasp.encoder.UNet` with an output channel for each angle, CLIPort's pick module
`equigrasp.encoder.TwoStream` so, and the kernel without steerability `equigrasp.kernel.PlainKernel`.
"""

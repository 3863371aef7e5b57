"""`python -m equigrasp`, the same as the command `equigrasp`."""

from equigrasp.cli import main

main()

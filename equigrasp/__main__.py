"""`python -m equigrasp`, and the command `equigrasp`.

What takes long to import is imported within `exits`, so that Ctrl-C in the first second is a stop like any other.
"""

from __future__ import annotations

from equigrasp.exits import exits, open_streams


def main() -> None:
    """Run the command that the process's arguments name."""
    open_streams()
    with exits("equigrasp"):
        from equigrasp.cli import main as run

        run()


if __name__ == "__main__":
    main()

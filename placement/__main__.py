"""The program `placement`, also `python -m placement`: Ctrl-C is heard from its first moment on."""

from __future__ import annotations

import sys

from placement.interrupts import held_back


def main() -> None:
    """Import the command line, and run it."""
    try:
        with held_back():
            from placement.cli import main as run
    except KeyboardInterrupt:
        sys.stderr.write("placement: interrupted; nothing was written\n")
        sys.exit(3)
    run()


if __name__ == "__main__":
    main()

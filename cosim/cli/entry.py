"""Entry point of the command: an interruption while modules are loading gives no traceback."""

from __future__ import annotations

import sys


def main() -> None:
    """Load the command line and run it."""
    try:
        from cosim.cli.application import main as run  # noqa: PLC0415 - to catch Ctrl-C while loading
    except KeyboardInterrupt:
        print("interrupted while loading, before any work began", file=sys.stderr)
        sys.exit(130)
    run()

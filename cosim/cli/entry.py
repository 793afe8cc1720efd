"""The way into the command: quiet about an interruption while everything is still loading."""

from __future__ import annotations

import sys


def main() -> None:
    """Load the command line and run it."""
    try:
        from cosim.cli.application import main as run  # noqa: PLC0415 - loading is what may be interrupted
    except KeyboardInterrupt:
        print("interrupted before anything had begun", file=sys.stderr)
        sys.exit(130)
    run()

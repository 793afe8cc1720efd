"""Say what a user should know although nothing failed: on standard error, once per process."""

from __future__ import annotations

import sys
from functools import cache


@cache
def say_once(text: str) -> None:
    """Print a line on standard error; the same text a second time is left out."""
    print(f"cosim: {text}", file=sys.stderr, flush=True)  # noqa: T201 - that is what it is for

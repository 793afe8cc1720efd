"""What is printed: notices, and text of others that cannot steer a terminal."""

from __future__ import annotations

import re
import sys
from contextlib import suppress

from cosim.core.made_once import once

_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")
"""Control characters other than tab and line feed, and marks that hide or turn round text."""


def printable(text: str) -> str:
    """Return text with a mark in place of every character that would steer a terminal.

    Names of files and names inside files are written by others.
    """
    return _STEERING.sub("\ufffd", text)


@once
def say_once(text: str) -> None:
    """Print a line on standard error; the same text a second time is left out."""
    _print(text)


def say_at_once(text: str) -> None:
    """Print a line on standard error if that can be done, from a signal handler as well."""
    with suppress(OSError, RuntimeError, ValueError):  # nobody hears it, or it interrupts a print
        _print(text)


def _print(text: str) -> None:
    if sys.stderr is None:  # closed; print would take standard output in its place
        return
    line = f"cosim: {printable(text)}"
    print(line, file=sys.stderr, flush=True)  # noqa: T201 - that is what it is for

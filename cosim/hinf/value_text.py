"""What stood in a file, short enough for a message."""

from __future__ import annotations

from typing import Any


def format_value(value: Any) -> str:
    """`repr` of at most 60 characters, whatever a hostile file holds."""
    try:
        text = repr(value)
    except ValueError:  # the interpreter refuses to print an integer of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:50]}... ({len(text)} characters)"

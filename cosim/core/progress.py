"""How far something long has come: whom it is reported to."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done."""


def silent(_what: str, _share: float) -> None:
    """No progress asked for."""

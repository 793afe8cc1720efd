"""Reports of progress of long tasks."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the name of the task and the share of it that is done, 0 to 1."""


def silent(_what: str, _share: float) -> None:
    """Report nothing."""

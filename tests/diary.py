"""An observer that writes down what it receives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.master import Observer


class Diary(Observer):
    """What an observer receives, in order: log lines behind the number of rows before them."""

    def __init__(self) -> None:
        self.lines: list[tuple[Any, ...]] = []
        self.rows = 0

    def begin(self, instances: Sequence[Any]) -> None:
        self.lines.append(("begin", len(instances)))

    def rows_complete(self, first: int, last: int) -> None:
        assert first == self.rows
        self.rows = last

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        self.lines.append((self.rows, time_ns, level, name, message))

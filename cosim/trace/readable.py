"""What frames and links ask of a trace: to be read topic by topic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from cosim.trace.layout import Signal
from cosim.trace.table import Table
from cosim.trace.topic_info import TopicInfo


class Readable(Protocol):
    """`cosim.trace.Trace`, as far as what is made of its topics needs it; described there."""

    path: Path
    topics: dict[str, TopicInfo]

    @property
    def signals(self) -> dict[str, tuple[str, Signal]]:
        """Topic and description of every signal, by name."""

    def place(self, name: str) -> tuple[str, str]:
        """Topic, and name within it, of a signal."""

    def read(self, topic: str, *, start: float | None = None, end: float | None = None) -> Table:
        """Rows of one topic."""

    def read_all(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: float | None = None,
        end: float | None = None,
    ) -> dict[str, Table]:
        """Tables of several topics."""

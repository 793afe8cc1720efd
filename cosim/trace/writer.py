"""Writing a trace: MCAP as it comes, readable at any moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from os import PathLike
    from pathlib import Path
    from types import TracebackType

    from cosim.trace.layout import Signal


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file carried inside the trace."""

    name: str
    media_type: str
    data: bytes


class TraceWriter:
    """Writes `<path>.partial`, renamed to `<path>` by `finish`."""

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        run: Mapping[str, str],
        attachments: Sequence[Attachment] = (),
        flush_interval_s: float = 1.0,
    ) -> None:
        raise NotImplementedError

    def add_topic(
        self,
        topic: str,
        signals: Sequence[Signal],
        *,
        schema_name: str,
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Declare a topic; returns the id that `write` takes."""
        raise NotImplementedError

    def add_dropped_topic(self, link: str) -> int:
        """Declare `/link/<link>/dropped`; write [reason] to it."""
        raise NotImplementedError

    def write(
        self,
        topic_id: int,
        log_time_ns: int,
        values: Sequence[Any],
        *,
        publish_time_ns: int | None = None,
        sequence: int = 0,
    ) -> None:
        """Write one row: a value per signal, None where absent."""
        raise NotImplementedError

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Write to `/log`; level "debug", "info", "warning", "error" or "fatal"."""
        raise NotImplementedError

    def pose(self, time_ns: int, x: float, y: float, z: float, psi: float) -> None:
        """Write to `/auv/pose`."""
        raise NotImplementedError

    def flush(self) -> None:
        """Bring all rows written so far to the operating system."""
        raise NotImplementedError

    def finish(self, result: Mapping[str, str]) -> Path:
        """Write `cosim.result`, close, rename; returns the final path."""
        raise NotImplementedError

    def close(self) -> None:
        """Close without a result; the `.partial` file stays, readable."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

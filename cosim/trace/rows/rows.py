"""Arrays of rows and poses for `TraceWriter.write_rows`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.rows.layout import VEHICLE

Integers = NDArray[np.int64]


@dataclass
class Rows:
    """Rows of one topic.

        >>> import numpy as np
        >>> from cosim import Trace
        >>> from cosim.trace import Rows, Signal, TraceWriter
        >>> with TraceWriter("dive.mcap", run={"title": "A dive"}) as writer:
        ...     depth = writer.add_topic("/log/depth", [Signal("z")], schema_name="log.Depth")
        ...     seconds = np.arange(3)
        ...     writer.write_rows([Rows(depth, seconds * 10**9, 2.0 * seconds[:, None])])
        ...     path = writer.finish({"status": "finished"})
        >>> Trace(path).read("/log/depth")["z"].tolist()
        [0.0, 2.0, 4.0]

    Attributes
    ----------
    topic_id : as `add_topic` returned it.
    log_ns : instants [ns], int64 (m,); of delivery, on a link.
    values : (m, signals), doubles, or m lists of values of the signals' own kinds.
    publish_ns : instants of sending [ns]; the log times by default.
    sequence : sequence numbers; zeros by default.
    rank : order of rows of the same log time: ascending in the first key, then the second, and
        so on; a tuple for all rows, or int64 (m, keys).
    """

    topic_id: int
    log_ns: Integers
    values: NDArray[np.float64] | Sequence[Sequence[Any]]
    publish_ns: Integers = field(default_factory=lambda: np.zeros(0, np.int64))
    sequence: Integers = field(default_factory=lambda: np.zeros(0, np.int64))
    rank: Integers | tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        if self.publish_ns.size == 0:
            self.publish_ns = self.log_ns
        if self.sequence.size == 0:
            self.sequence = np.zeros(self.log_ns.size, np.int64)


@dataclass
class Lines:
    """Lines of the log: instants [ns], level, name and message of each, in order of time."""

    log_ns: Integers
    lines: Sequence[tuple[str, str, str]]
    rank: tuple[int, ...] = (0,)


@dataclass
class Poses:
    """Poses of a vehicle: x, y, z [m] and psi [rad], (m, 4); the rest as in `Rows`.

    Attributes
    ----------
    vehicle : its frame, and the first part of its topics: `/auv/pose`.
    reference : whether these are where it is to be, `/auv/reference`, not where it is.
    """

    log_ns: Integers
    values: NDArray[np.float64]
    rank: Integers | tuple[int, ...] = (0,)
    vehicle: str = VEHICLE
    reference: bool = False

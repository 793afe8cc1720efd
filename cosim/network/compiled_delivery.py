"""The loop of `Delivery` over many messages as machine code: `delivery.c`, same results.

Whoever opens links passes the library (`cosim.master` has it with its kernel): here nothing is
compiled.
"""

from __future__ import annotations

import ctypes
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.network.arrival_log import COLUMNS
from cosim.network.stepping import Arrival, Receiver, Reception, Rules, Sender, Sending

Integers = NDArray[np.int64]

_SENDER: Final = len(Rules._fields)
_RECEIVER: Final = _SENDER + len(Sender._fields)
_POINTS: Final = _RECEIVER + len(Receiver._fields)
_COUNTS: Final = _POINTS + 2
"""Where these begin in `Delivery` of delivery.c: how many are due, how many copies there were."""


class LinkEnds(NamedTuple):
    """Both ends of a link, and what is due between them: when, turn at that instant, what."""

    sender: Sender | Sending
    receiver: Receiver | Reception
    due: list[tuple[int, int, Arrival]]


class CompiledDelivery:
    """`deliver` of delivery.c; pickled it is None, since a process has its own library."""

    def __init__(self, library: ctypes.CDLL) -> None:
        address, number = ctypes.c_void_p, ctypes.c_int64
        self._call = library.deliver
        self._call.restype = number
        self._call.argtypes = [address, address, *[number] * 3, *[address] * 3, number]

    def __reduce__(self) -> Any:
        """See the class."""
        return type(None), ()

    def __deepcopy__(self, _: Any) -> CompiledDelivery:
        """Return itself: it has no state."""
        return self

    def deliver(
        self,
        rules: Rules,
        points: tuple[int, int],
        before: LinkEnds,
        first: int,
        block: Integers,
        horizon_ns: int,
    ) -> tuple[LinkEnds, Integers, Integers]:
        """Send messages `first` and following, and receive what is due before an instant.

        Parameters
        ----------
        points : their step, and the end of the run [ns].
        block : the messages, int64 (n, 6).

        Returns
        -------
        The ends of the link after it; the arrivals, columns of `ArrivalLog`, int64 (8, m); when the
        messages were sent of which there are copies [ns], int64 (c,).
        """
        n, room = len(block), len(before.due) + 2 * len(block)
        due = np.empty((room, 5), np.int64)
        if before.due:
            due[: len(before.due)] = [(time, turn, *what) for time, turn, what in before.due]
        ends = (*before.sender[:2], *before.receiver[:5])
        state = np.array([*rules, *ends, *points, len(before.due), 0], np.int64)
        columns, copies = np.empty((len(COLUMNS), room), np.int64), np.empty(n, np.int64)
        block = np.ascontiguousarray(block)
        count = self._call(
            *(state.ctypes.data, due.ctypes.data, horizon_ns, first, n, block.ctypes.data),
            *(copies.ctypes.data, columns.ctypes.data, room),
        )
        values = state.tolist()
        waiting, copied = values[_COUNTS:]
        after = LinkEnds(
            Sender(*values[_SENDER:_RECEIVER]),
            Receiver(*values[_RECEIVER:_POINTS]),
            [(time, turn, Arrival(*what)) for time, turn, *what in due[:waiting].tolist()],
        )
        return after, columns[:, :count], copies[:copied]

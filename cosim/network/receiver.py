"""The receiver of a live link, with a record of what it received."""

from __future__ import annotations

from array import array

import numpy as np

from cosim.network.packet_schedule import DELIVERED
from cosim.network.state import NONE_YET, SUBSTITUTE, Timeline
from cosim.network.stepping import Arrival, Receiver, Reception, Rules, receive


class ReceiverRecord:
    """Receives entry by entry what arrives, is due but lost, or was refused.

    Each entry is appended to the columns of a `Timeline`, and to `message` (its number) and
    `status`; `change_ns` are the instants at which the message in use changed.
    """

    def __init__(self, rules: Rules) -> None:
        self._rules = rules
        self._now: Receiver | Reception = Receiver()
        self._used = NONE_YET
        self.time_ns, self.message, self.status = array("q"), array("q"), array("b")
        self.used, self.sequence, self.origin_ns = array("q"), array("q"), array("q")
        self.dropped, self.delivered, self.change_ns = array("q"), array("q"), array("q")

    def receive(self, time_ns: int, entry: int, arrival: Arrival) -> None:
        """Receive the next entry in order of time, at one instant in order of sending.

        Parameters
        ----------
        time_ns : instant of arrival, or at which it was due or refused [ns].
        entry : its index.
        """
        self._now = found = receive(self._rules, self._now, arrival)
        if found.status == DELIVERED or found.noticed:
            self._used = SUBSTITUTE if found.noticed else entry
            if not self.change_ns or self.change_ns[-1] != time_ns:
                self.change_ns.append(time_ns)
        self.time_ns.append(time_ns)
        self.message.append(arrival.message)
        self.status.append(found.status)
        self.used.append(self._used)
        self.sequence.append(found.sequence)
        self.origin_ns.append(found.origin_ns)
        self.dropped.append(found.dropped)
        self.delivered.append(found.delivered)

    def timeline(self) -> Timeline:
        """Return the record so far, as arrays that are valid until the next `receive`."""
        columns = (getattr(self, name) for name in Timeline._fields)
        return Timeline(*(np.frombuffer(column, np.int64) for column in columns))

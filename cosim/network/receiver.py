"""The receiver of a link, entry by entry, with a record of what it received."""

from __future__ import annotations

from array import array

import numpy as np

from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import DELIVERED, DUPLICATE, LOST, OVERTAKEN
from cosim.network.state import NONE_YET, SUBSTITUTE, Timeline


class Receiver:
    """Decides what becomes of each entry that arrives, is due but lost, or was refused.

    Each entry is appended to the columns of a `Timeline`, and to `message` (its number) and
    `status`; `change_ns` are the instants at which the message in use changed.
    """

    def __init__(self, link: PacketLink) -> None:
        self._newest_wins = link.order == "newest-wins"
        self._substitutes = link.on_loss != "hold"
        self._newest = NONE_YET
        self._used, self._sequence, self._origin_ns = NONE_YET, NONE_YET, 0
        self._dropped = self._delivered = 0
        self.time_ns, self.message, self.status = array("q"), array("q"), array("b")
        self.used, self.sequence, self.origin_ns = array("q"), array("q"), array("q")
        self.dropped, self.delivered, self.change_ns = array("q"), array("q"), array("q")

    def receive(self, time_ns: int, entry: int, message: int, status: int, sent_ns: int) -> None:
        """Receive the next entry in order of time, at one instant in order of sending.

        Parameters
        ----------
        time_ns : instant of arrival, or at which it was due or refused [ns].
        entry, message : its index and its number.
        status : DELIVERED if the channel delivers it, or why not.
        sent_ns : instant of sending [ns].
        """
        if status == DELIVERED and self._newest_wins and message <= self._newest:
            status = DUPLICATE if message == self._newest else OVERTAKEN
        elif status == DELIVERED:
            self._use(time_ns, entry, message)
            self._newest = max(self._newest, message)
            self._origin_ns = sent_ns
        elif status == LOST and self._substitutes and self._newest < message:
            self._use(time_ns, SUBSTITUTE, SUBSTITUTE)
        self._delivered += status == DELIVERED
        self._dropped += status != DELIVERED
        self.time_ns.append(time_ns)
        self.message.append(message)
        self.status.append(status)
        self.used.append(self._used)
        self.sequence.append(self._sequence)
        self.origin_ns.append(self._origin_ns)
        self.dropped.append(self._dropped)
        self.delivered.append(self._delivered)

    def timeline(self) -> Timeline:
        """Return the record so far, as arrays that are valid until the next `receive`."""
        columns = (getattr(self, name) for name in Timeline._fields)
        return Timeline(*(np.frombuffer(column, np.int64) for column in columns))

    def _use(self, time_ns: int, entry: int, message: int) -> None:
        self._used, self._sequence = entry, message
        if not self.change_ns or self.change_ns[-1] != time_ns:
            self.change_ns.append(time_ns)

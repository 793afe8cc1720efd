"""The statistics of a link, counted on while what they count is forgotten."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.network.arrivals import (
    DELIVERED,
    DUPLICATE,
    LATE,
    LOST,
    ON_MEDIUM,
    OVERTAKEN,
    QUEUE_FULL,
    REASONS,
)
from cosim.network.packet import PacketLink
from cosim.network.received import Received
from cosim.network.state import SUBSTITUTE
from cosim.network.stepping import Receiver

Statistics = dict[str, int | float | None]


class Tally(NamedTuple):
    """What was counted of a link from the start of its run.

    Attributes
    ----------
    counts : how many entries had each status.
    delay_ns, longest_ns : sum and maximum of the delays of what was delivered [ns]; -1 before.
    substitutions : losses after which the substitute came into use.
    oldest_ns : largest age of a message when it was replaced [ns]; -1 before the first.
    """

    counts: tuple[int, ...] = (0,) * len(REASONS)
    delay_ns: int = 0
    longest_ns: int = -1
    substitutions: int = 0
    oldest_ns: int = -1

    def counted(self, received: Received) -> Tally:
        """Return the tally that counts these entries, too; all of one instant come together."""
        counts = np.bincount(received.status, minlength=len(REASONS)).tolist()
        arrived = received.status == DELIVERED
        delay = received.arrival_ns[arrived] - received.sent_ns[arrived]
        changes = received.changes()
        times, used = received.arrival_ns[changes], received.sequence[changes]
        before = received.before
        earlier = np.append(np.int64(before.sequence), used)[:-1]
        origin = np.append(np.int64(before.origin_ns), received.origin_ns[changes])[:-1]
        age = (times - origin)[earlier >= 0]
        return Tally(
            counts=tuple(a + b for a, b in zip(self.counts, counts, strict=True)),
            delay_ns=self.delay_ns + _sum(delay),
            longest_ns=max(self.longest_ns, int(delay.max(initial=-1))),
            substitutions=self.substitutions + int(np.count_nonzero(used == SUBSTITUTE)),
            oldest_ns=max(self.oldest_ns, int(age.max(initial=-1))),
        )

    def statistics(
        self, link: PacketLink, sent: int, duplicated: int, end_ns: int, receiver: Receiver
    ) -> Statistics:
        """Return the statistics of a run that ended at `end_ns` with this receiver.

        They are described at `PacketSchedule.statistics`.
        """
        counts, delivered = self.counts, self.counts[DELIVERED]
        oldest = max(self.oldest_ns, end_ns - receiver.origin_ns if receiver.sequence >= 0 else -1)
        copies, has_queue_limit = link.duplicate > 0, link.queue_limit is not None
        # links of their own have the keys that they had before there were media
        fates = () if link.hop is None else ON_MEDIUM
        return {
            "sent": sent,
            "duplicated": duplicated if copies else None,
            "delivered": delivered,
            "dropped": sum(counts) - delivered,
            "lost": counts[LOST],
            "overtaken": counts[OVERTAKEN],
            "late": counts[LATE] if link.playout_ns else None,
            "queue_full": counts[QUEUE_FULL] if has_queue_limit else None,
            **{REASONS[fate].replace(" ", "_"): counts[fate] for fate in fates},
            "discarded_copies": counts[DUPLICATE] if copies else None,
            "in_flight": sent + duplicated - sum(counts),
            "substitutions": self.substitutions,
            "mean_delay_s": self.delay_ns / delivered / 1e9 if delivered else None,
            "max_delay_s": self.longest_ns / 1e9 if delivered else None,
            "max_age_s": oldest / 1e9 if oldest >= 0 else None,
        }


def _sum(values: NDArray[np.int64]) -> int:
    """Return the sum of numbers from 0 up, exactly: 64 bits may not hold it."""
    return (int((values >> 32).sum()) << 32) + int((values & 0xFFFFFFFF).sum())

"""When a recorded link is in touch, by the definition of it, instant by instant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.network import Recording


def in_touch(
    recording: Recording, oldest: float, other: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Instants [s], and between each two whether the newest message in use is young enough.

    From the first sending to the last, shapes (n + 1,) and (n,). A message is in use from `other`
    after its arrival on; it is young enough until it is `oldest` old.
    """
    came = recording.arrived
    sent = recording.sent_ns[came] / 1e9
    delay = 0.0 if recording.delay_ns is None else recording.delay_ns[came] / 1e9
    used, end = sent + delay + other, recording.sent_ns[-1] / 1e9
    times = np.unique(np.concatenate([[0.0, end], used, sent + oldest]))
    times = times[(times >= 0.0) & (times <= end)]
    between = (times[:-1] + times[1:]) / 2
    newest = np.array([sent[used <= t].max(initial=-np.inf) for t in between])
    return times, between - newest < oldest

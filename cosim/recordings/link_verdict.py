"""What a proof across outages says of a recorded link: up for long enough, bounded, in mean square.

A recording is read as the link of a loop: up from the arrival of a message on, as long as the
newest one that has arrived, with what else makes it older, is no older than designed for; the
proved fallback acts otherwise. Before the first arrival is an outage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.core import InputError
from cosim.recordings.hidden_chain import HiddenChain, fit_chain
from cosim.recordings.statistics import LinkStatistics, statistics_of

if TYPE_CHECKING:
    from cosim.network import Recording

_REGULAR = 0.01
"""Relative: intervals between messages that differ by less count as one period."""


@dataclass(frozen=True)
class OutageVerdict:
    """The verdict on one recorded link.

    Attributes
    ----------
    statistics : of the recording.
    age_s : greatest age that the proof allows [s]; of it `other_s` are not the link's.
    bound : what the proof bounds over the recording.
    chain : of two hidden states, fitted to the losses; None where all or none were lost.
    rates : mean square by the proved rates, for that chain; None without a chain or a period.
    jump : mean square of the nominal loop as a jump system, for that chain; None where the plant
        has delays of its own.
    remarks : what could not be decided, and why.
    """

    statistics: LinkStatistics
    age_s: float
    other_s: float
    bound: hinf.delay_lti.OutageBound
    chain: HiddenChain | None
    rates: hinf.delay_lti.MeanSquare | None
    jump: hinf.delay_lti.MeanSquare | None
    remarks: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether the share of time with the link up suffices: V falls over the recording."""
        return self.bound.share_had > self.bound.share_needed


def outage_verdict(recording: Recording, design: hinf.Result, other: float = 0.0) -> OutageVerdict:
    """Judge a recorded link by a design that is proved across outages.

        >>> from cosim import DelaySystem, analyse, link
        >>> from cosim.hinf.synthesis import with_outages
        >>> from cosim.network import Recording
        >>> from cosim.recordings import outage_verdict
        >>> loop = DelaySystem([[-0.1]], [[1]], delays=[link(1.5)])
        >>> proved = with_outages(analyse(loop, [[-0.2]], order=0))
        >>> times = range(0, 60 * 10**9, 10**9)
        >>> lost = [k % 10 == 9 for k in range(60)]
        >>> recording = Recording(times, lost, [10**8] * 60)  # each 0.1 s under way
        >>> verdict = outage_verdict(recording, proved, other=0.1)
        >>> verdict.holds, verdict.bound.share_had > 0.9, verdict.statistics.lost
        (True, True, 6)

    Parameters
    ----------
    design : with the guarantee `outages` (`cosim.hinf.synthesis.with_outages`).
    other : further age of a measurement beyond that of its message, receiver's step included [s].

    Raises
    ------
    InputError : no such proof, a recording of one instant, or `other` beyond the age allowed.
    """
    proved = design.guarantees.outages
    if proved is None:
        raise InputError(
            "this design proves nothing across outages",
            where="design",
            expected="guarantees.outages in its certificate",
            hint="cosim design --outages --save, or cosim.hinf.synthesis.with_outages",
        )
    oldest = next(x.d for x in design.system.delays if x.feedback)
    if not 0 <= other < oldest:
        raise InputError(
            "nothing is left of the age that the proof allows",
            where="other",
            expected=f"0 s or more, and less than {oldest:g} s",
            got=f"{other:g} s",
        )
    times, touch = in_touch(recording, oldest, other)
    remarks: list[str] = []
    if recording.delay_ns is None:
        remarks.append("no times of arrival were recorded: messages count as arriving when sent")
    lost = recording.lost[recording.ended]
    chain = fit_chain(lost, 2).chain if lost.any() and not lost.all() else None
    rates = jump = None
    if chain is None:
        remarks.append("no chain: all messages were lost, or none")
    else:
        period, late = _period(recording), _playout(recording) + other
        if period is None:
            remarks.append("no mean square: the messages have no period")
        elif late + period > oldest:
            remarks.append(
                f"no mean square: a message each {period:g} s, used from {late:.4g} s on, is older "
                f"than {oldest:g} s before the next one comes"
            )
        else:
            rates = hinf.delay_lti.rates_mean_square(proved, chain.transitions, chain.loss, period)
            if len(design.system.delays) == 1 and not proved.fallback.any():
                own = chain.transitions, chain.loss, period, late
                jump = hinf.delay_lti.jump_mean_square(design.system, design.K, *own)
    return OutageVerdict(
        statistics=statistics_of(recording),
        age_s=oldest,
        other_s=other,
        bound=hinf.delay_lti.outage_bound(proved, times, touch),
        chain=chain,
        rates=rates,
        jump=jump,
        remarks=tuple(remarks),
    )


def in_touch(
    recording: Recording, oldest: float, other: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return instants [s] and, between each two, whether the newest message is young enough.

    From the first sending to the last; shapes (n + 1,) and (n,). A message is in use from `other`
    after its arrival on, until it is `oldest` seconds old or the next one is in use.

    Raises
    ------
    InputError : a recording of one instant.
    """
    end = int(recording.sent_ns[-1])
    if end == 0:
        raise InputError("there is no time in a recording of one instant", where="recording")
    came = recording.arrived
    sent = recording.sent_ns[came]
    at = sent if recording.delay_ns is None else sent + recording.delay_ns[came]
    order = np.argsort(at, kind="stable")
    begins, newest = at[order] + round(other * 1e9), np.maximum.accumulate(sent[order])
    ends = np.minimum(newest + round(oldest * 1e9), np.append(begins[1:], end))
    some = (ends > begins) & (begins < end)
    begins, ends = begins[some], np.minimum(ends[some], end)
    times = np.unique(np.concatenate([[0, end], begins, ends]))
    place = np.searchsorted(begins, times[:-1], side="right") - 1
    last = np.append(ends, 0)[place]
    return times / 1e9, (place >= 0) & (times[:-1] < last)


def _period(recording: Recording) -> float | None:
    """Return the time between messages [s]; None where it varies."""
    intervals = np.diff(recording.sent_ns)
    middle = float(np.median(intervals))
    regular = middle > 0 and (np.abs(intervals - middle) <= _REGULAR * middle).mean() > 1 - _REGULAR
    return middle / 1e9 if regular else None


def _playout(recording: Recording) -> float:
    """Return the age at which all messages that arrived had done so [s]."""
    if recording.delay_ns is None or not recording.arrived.any():
        return 0.0
    return float(recording.delay_ns[recording.arrived].max()) / 1e9

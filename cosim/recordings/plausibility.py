"""Whether a log was read as it was meant: a line that says what is in it, and what looks wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cosim.core import AnyPath, counted, say_once
from cosim.network import UNIT_WORDS, LogFormat, Recording, Unit, seconds_in_words, unit_doubt

_ALIKE = 10
"""Delays of as many messages that are all equal are asked about."""
_FAR_APART_S = 100.0
_SHORT_S = 1.0
_LARGER: dict[Unit, Unit] = {"ns": "us", "us": "ms", "ms": "s"}
_SPANS = ((172_800.0, 86_400.0, "days"), (7200.0, 3600.0, "h"), (120.0, 60.0, "min"))


@dataclass(frozen=True)
class Plausibility:
    """What is in a recording, in one line, and what looks wrong.

    Attributes
    ----------
    messages, lost : how many; what was in flight at the end counts in `messages` only.
    span_s : from the first sending to the last [s].
    median_delay_s : of the messages that arrived [s]; None where none did, or without times.
    loss : share of the messages that were lost; None if all were in flight.
    doubts : what looks wrong, each with what to do where it is.
    """

    messages: int
    span_s: float
    median_delay_s: float | None
    lost: int
    loss: float | None
    doubts: tuple[str, ...]

    @property
    def line(self) -> str:
        """The recording in one line."""
        delay = "no times of arrival"
        if self.median_delay_s is not None:
            delay = f"median delay {seconds_in_words(self.median_delay_s)}"
        lost = "none ended" if self.loss is None else f"{100 * self.loss:.3g} % lost"
        return f"{counted(self.messages, 'message')} over {_span(self.span_s)}, {delay}, {lost}"

    def to_json(self) -> dict[str, Any]:
        """Return the fields and the line, for `--json`."""
        return asdict(self) | {"line": self.line, "doubts": list(self.doubts)}

    def ask(self, path: AnyPath, name: str = "") -> None:
        """Print what looks wrong on standard error, each once."""
        place = f"{path}, {name}" if name else f"{path}"
        for doubt in self.doubts:
            say_once(f"{place}: {doubt}")


def plausibility_of(
    recording: Recording,
    log_format: LogFormat,
    *,
    unit: Unit | None,
    asked: Sequence[str] = (),
    logged: bool = True,
) -> Plausibility:
    """Return what is in a recording, and what looks wrong.

    Parameters
    ----------
    unit : in which its times were read; None where they are no numbers.
    asked : what is doubtful about the rows themselves.
    logged : whether a log of messages was read; of an MCAP file, whose times have their unit and
        may be of a simulation, only what is wrong in any unit is asked.
    """
    delays = recording.delay_ns
    came = None if delays is None else delays[recording.arrived] / 1e9
    lost = recording.lost[recording.ended]
    span_s = float(recording.sent_ns[-1]) / 1e9
    median_s = float(np.median(came)) if came is not None and came.size else None
    doubts = list(asked)
    doubt = None if median_s is None else unit_doubt(median_s, unit, log_format)
    intervals = np.diff(recording.sent_ns) / 1e9
    if doubt is not None:
        doubts.append(doubt)
    elif logged and intervals.size and np.median(intervals) > _FAR_APART_S:
        doubts.append(_far_apart(float(np.median(intervals)), unit, log_format))
    if logged and intervals.size and span_s < _SHORT_S:
        doubts.append(_short(span_s, unit, log_format))
    if lost.size and lost.all():
        doubts.append("all messages are lost: is that what these cells mean?")
    if logged and came is not None and came.size >= _ALIKE and np.ptp(came) == 0.0:
        same = seconds_in_words(float(came[0]))
        doubts.append(f"all delays are {same}: were they measured, or is this a setting?")
    return Plausibility(
        messages=len(recording),
        span_s=span_s,
        median_delay_s=median_s,
        lost=int(np.count_nonzero(lost)),
        loss=float(lost.mean()) if lost.size else None,
        doubts=tuple(doubts),
    )


def _far_apart(interval_s: float, unit: Unit | None, log_format: LogFormat) -> str:
    words = f"messages are {seconds_in_words(interval_s)} apart (median)"
    if unit is None or unit == "ns":
        return f"{words}: is that so?"
    smaller = next(small for small, large in _LARGER.items() if large == unit)
    return f"{words}: are these {UNIT_WORDS[smaller]}? give {log_format.named(unit=smaller)}"


def _short(span_s: float, unit: Unit | None, log_format: LogFormat) -> str:
    words = f"all messages were sent within {seconds_in_words(span_s)}"
    if unit not in _LARGER:
        return f"{words}: is that so?"
    larger = _LARGER[unit]
    return f"{words}: are these {UNIT_WORDS[larger]}? give {log_format.named(unit=larger)}"


def _span(seconds: float) -> str:
    """Return a length of time with three digits, in the unit that people use for as long a one."""
    for least, size, unit in _SPANS:
        if seconds >= least:
            return f"{seconds / size:.3g} {unit}"
    return seconds_in_words(seconds)

"""Judge the numbers that an FMU returns before they are used: instants, intervals and sizes.

An FMU may return any bits. What is asked for here is what a right answer can be:

===================================  ==========================================================
lastSuccessfulTime of a step         within the step
nextEventTime                        finite, later than now
the time of a value within a step    within the step, not before the one before
the interval of a Clock              finite, not negative; of a periodic one at least 1 ns
its qualifier                        one that FMI knows
the shift of a Clock                 finite, not negative
the size of a Binary or String       at most `MOST_BYTES`, at an address
the size of a serialised state       at most `MOST_OF_STATE`
===================================  ==========================================================

A time that is finite and later than the end of a run never comes: it is no fault. The clock of an
FMU that sums its steps may lag: within `LAG_S` an instant is at the border that it has missed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from ctypes import string_at
from fractions import Fraction
from typing import Any, Final, NamedTuple

from _cffi_backend import FFI  # reads C types itself: no parser of C has to be loaded

from cosim.core import ComponentError

LAG_S: Final = 1e-6
"""So far the clock of an FMU may be from that of the run [s]; at great times four units in the
last place of a double, if that is more."""
LEAST_INTERVAL: Final = Fraction(1, 10**9)
"""Of a periodic Clock [s]: instants of a run are whole nanoseconds."""
MOST_BYTES: Final = 1 << 24
"""Bytes of one Binary or String (16 MiB). A run keeps each of its values, and a parent receives it
between two looks at the limits and at Ctrl-C."""
MOST_OF_STATE: Final = 1 << 30
"""Bytes of one serialised state (1 GiB)."""
MOST_OF_MESSAGE: Final = 1 << 16
"""Bytes of one log message that are kept (64 KiB)."""
RawInterval = float | tuple[int, int]
"""An interval or shift as an FMU gives it: seconds, or a counter and its resolution."""
_QUALIFIERS: Final = (0, 1, 2)
_FFI: Final = FFI()


def within(time: float, begin: float, end: float) -> float | None:
    """Return the instant of a step from `begin` to `end` that a time [s] is; None if it is none."""
    lag = _lag(begin, end)
    if not begin - lag <= time <= end + lag:  # nor is NaN
        return None
    return min(max(time, begin), end)


def exactly(seconds: float) -> Fraction:
    """Return the number that a double stands for: 1/10 for 0.1, the shortest that rounds to it."""
    return Fraction(repr(seconds))


def shortened(raw: bytes | None) -> str:
    """Return the text of a log message, cut with a remark of how long it was."""
    text = (raw or b"")[:MOST_OF_MESSAGE].decode("utf-8", "replace")
    if raw is None or len(raw) <= MOST_OF_MESSAGE:
        return text
    return f"{text} ... (cut: the message has {len(raw)} bytes)"


class Returned(NamedTuple):
    """What a call of a component returned, which is judged.

    Attributes
    ----------
    call : the FMI function.
    component, where : the component, by name and in messages.
    """

    call: str
    component: str
    where: str

    def time_reached(self, time: float, begin: float, end: float) -> float:
        """Return the instant at which a step from `begin` ended before `end` [s]."""
        found = within(time, begin, end)
        if found is None:
            what = "a last successful time that is not in its step"
            raise self._error(what, _span(begin, end), f"t = {time:.10g} s")
        return found

    def times_within(self, times: Iterable[float], begin: float, end: float) -> list[float]:
        """Return the instants of values within a step from `begin` to `end` [s]."""
        judged: list[float] = []
        for time in times:
            found = within(time, judged[-1] if judged else begin, end)
            if found is None:
                what = "values for a time that is not within its step, or not in order,"
                raise self._error(what, _span(begin, end), f"t = {time:.10g} s")
            judged.append(found)
        return judged

    def next_event(self, time: float, now: Fraction) -> Fraction:
        """Return the instant of the next time event, at `now` [s]."""
        if not float(now) - _lag(float(now)) <= time < math.inf:
            expected = f"a finite time after t = {float(now):.10g} s"
            what = "a time of the next event that does not come"
            raise self._error(what, expected, f"t = {time:.10g} s")
        return Fraction(time)

    def interval(
        self,
        name: str,
        raw: RawInterval,
        *,
        what: str = "an interval",
        least: Fraction = Fraction(0),
    ) -> Fraction:
        """Return the interval of a Clock, or with `what` its shift."""
        value = None
        if isinstance(raw, tuple):
            value = Fraction(*raw) if raw[1] > 0 else None
        elif math.isfinite(raw):
            value = exactly(raw)
        if value is None or value < least:
            got = f"{raw[0]}/{raw[1]} s" if isinstance(raw, tuple) else f"{raw:g} s"
            expected = f"a finite one of at least {float(least):g} s"
            raise self._error(f"{what} of {name} that is none", expected, got)
        return value

    def qualifier(self, name: str, number: int) -> int:
        """Return the qualifier of an interval."""
        if number not in _QUALIFIERS:
            what = f"an interval of {name} with a qualifier that FMI does not know"
            raise self._error(what, "0, 1 or 2", str(number))
        return number

    def content(self, address: int | None, size: int) -> bytes:
        """Return the bytes of a Binary."""
        if size > MOST_BYTES or (size and not address):
            expected = f"at most {MOST_BYTES} bytes, at an address"
            got = f"{size} bytes" + " at no address" * (not address)
            raise self._error("a Binary that cannot be read", expected, got)
        return string_at(address, size) if address and size else b""

    def text(self, address: int | None) -> bytes | None:
        """Return the bytes of a String, before its zero; None for none."""
        if not address:
            return None
        pointer: Any = _FFI.cast("char *", address)
        found: Any = _FFI.string(pointer, MOST_BYTES + 1)
        if len(found) > MOST_BYTES:
            most = f"{MOST_BYTES} bytes"
            raise self._error("a String that is too long", f"at most {most}", f"more than {most}")
        return bytes(found)

    def size_of_state(self, size: int) -> int:
        """Return the size of a serialised state."""
        if size > MOST_OF_STATE:
            expected = f"at most {MOST_OF_STATE} bytes"
            raise self._error("a state that is too large", expected, f"{size} bytes")
        return size

    def _error(self, what: str, expected: str, got: str) -> ComponentError:
        fact = f"{self.call} returned {what}"
        return ComponentError(
            fact,
            where=self.where,
            expected=expected,
            got=got,
            component=self.component,
            call=self.call,
            detail=f"{fact}: {got}",
        )


def _lag(*times: float) -> float:
    return max(LAG_S, *(4.0 * math.ulp(time) for time in times))


def _span(begin: float, end: float) -> str:
    return f"from t = {begin:.10g} s to t = {end:.10g} s"

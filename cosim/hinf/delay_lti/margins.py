"""Gain, phase and delay margin of a loop with delays, and what its Nyquist curve says.

All crossings of |L| = 1 and of the negative real axis are found up to a frequency beyond which |L|
is proved to be smaller; between two samples neither phase nor log |L| changes by more than a third,
and extrema near a crossing are refined. With delays there are many phase crossings: the margin is
that of the nearest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from cosim.core import InputError, NotAchievableError, html_table
from cosim.hinf.delay_lti.blocks import Blocks, Complexes, Reals, balanced_blocks
from cosim.hinf.delay_lti.high_frequency import HighFrequency
from cosim.hinf.delay_lti.winding import Winding, winding_of

_RELATIVE = 4 * float(np.finfo(np.float64).eps)
_CHANGE = 0.35  # of phase [rad] and of log |L| between samples
_MOST_SAMPLES = 300_000
_NEAR = 0.4  # log |L| of an extremum that may be a crossing
_SMALLEST = 1e-3  # |L| below which a gain margin is not looked for
_FARTHER = 64.0  # times what was looked at first


@dataclass(frozen=True, repr=False)
class Margins:
    """What one loop L, closed by u = r - L u, can stand; L as it is must be stable in the loop.

    Attributes
    ----------
    stable : whether the closed loop is stable; only then do the others mean anything.
    gain : factor > 1 by which L may grow; infinite if none up to 1000 is too much.
    gain_decrease : factor < 1 to which L may shrink; 0 where any does.
    phase : the least phase lag or lead [rad] that ends stability; infinite without |L| = 1.
    delay : the least further delay [s] that ends it; infinite without |L| = 1.
    gain_frequency, decrease_frequency, phase_frequency, delay_frequency : where [rad/s]; nan where
        the margin is infinite or zero.
    """

    stable: bool
    gain: float
    gain_decrease: float
    phase: float
    delay: float
    gain_frequency: float
    decrease_frequency: float
    phase_frequency: float
    delay_frequency: float

    def __str__(self) -> str:
        """Return the margins in one line."""
        if not self.stable:
            return "the closed loop is not stable"
        decibel = 20.0 * math.log10(self.gain) if math.isfinite(self.gain) else math.inf
        text = (
            f"gain {self.gain:.4g} ({decibel:.3g} dB), "
            f"phase {math.degrees(self.phase):.4g} deg, delay {self.delay:.4g} s"
        )
        return text + (f", gain down to {self.gain_decrease:.4g}" if self.gain_decrease else "")

    def __repr__(self) -> str:
        return f"<Margins: {self}>"

    def _repr_html_(self) -> str:
        """Return every margin with its frequency, as notebooks show them."""
        rows = {
            "gain": f"{self.gain:.6g} at {self.gain_frequency:.6g} rad/s",
            "gain decrease": f"{self.gain_decrease:.6g} at {self.decrease_frequency:.6g} rad/s",
            "phase": f"{math.degrees(self.phase):.6g} deg at {self.phase_frequency:.6g} rad/s",
            "delay": f"{self.delay:.6g} s at {self.delay_frequency:.6g} rad/s",
        }
        return html_table(repr(self), rows if self.stable else {})


def margins_of(loop: Blocks, winding: Winding | None = None) -> Margins:
    """Compute the margins of a loop L with one input and one output.

    Raises
    ------
    InputError : more inputs or outputs.
    NotAchievableError : as `winding_of`, but for a loop at the limit of stability.
    """
    if (loop.inputs, loop.outputs) != (1, 1):
        raise InputError(
            "margins are those of one loop",
            where="loop",
            expected="one input and one output",
            got=f"{loop.inputs} inputs, {loop.outputs} outputs",
            hint="the norm of the sensitivity, (I + L)^-1, is the measure for several at once",
        )
    loop = balanced_blocks(loop)[0]
    stable = (winding or winding_of(loop)).closed_roots == 0
    top, last = _ends(loop)
    crossings = _Crossings(loop, top).of_one()
    samples = _Crossings(loop, last)
    gain, decrease = samples.gain_margin(), samples.gain_decrease()
    high = HighFrequency(loop)
    # of phase crossings the one of greatest |L| < 1 counts: one beyond may still be greater
    enough = high.last(1.0 / gain[0]) if math.isfinite(gain[0]) else last
    if last < enough < _FARTHER * last:
        gain = _Crossings(loop, enough).gain_margin()
    if loop.Dw.any() and loop.Dv.any():
        # behind a delay the direct part crosses for ever, as near to its size as one likes
        gain = min(gain, (1.0 / high.direct, math.inf))
    phase, delay = _of_crossings(loop, crossings)
    frequencies = (gain[1], decrease[1], phase[1], delay[1])
    return Margins(stable, gain[0], decrease[0], phase[0], delay[0], *frequencies)


def _ends(loop: Blocks) -> tuple[float, float]:
    """Return frequencies above which |L| is not one, and is too small for a gain margin."""
    high = HighFrequency(loop)
    several = 4.0 * math.pi / float(loop.delays.min(initial=math.inf))  # turns of every delay
    least = max(several, high.a, 1e-300) or 1.0
    top = high.last(1.0 - 1e-9)
    if not math.isfinite(top):  # a constant direct part of one or more
        top = high.last(1.001 * high.direct)
    last = high.last(max(_SMALLEST, high.direct + 0.1 * abs(1.0 - high.direct)))
    return max(top, least), max(last, top, least)


def _of_crossings(
    loop: Blocks, omega: list[float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (phase margin, frequency) and (delay margin, frequency)."""
    phase, delay = (math.inf, math.nan), (math.inf, math.nan)
    for w in omega:
        lag = (float(np.angle(loop.at(1j * w)[0, 0])) + math.pi) % (2.0 * math.pi)
        phase = min(phase, (min(lag, 2.0 * math.pi - lag), w))
        if w > 0.0:
            delay = min(delay, (lag / w, w))
    return phase, delay


class _Crossings:
    """Samples of L up to a frequency, close enough that no crossing hides between two."""

    def __init__(self, loop: Blocks, top: float) -> None:
        self.loop = loop
        tau = float(loop.delays.max(initial=0.0))
        even = np.linspace(0.0, top, 65 + int(min(2.0 * top * tau, 20_000.0)))[1:]
        omega = np.union1d(even, np.geomspace(1e-7 * top, top, 500))
        values = self.at(omega)
        for _ in range(40):
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = values[1:] / values[:-1]
                change = np.maximum(np.abs(np.angle(ratio)), np.abs(np.log(np.abs(ratio))))
            split = np.flatnonzero(~(change <= _CHANGE) & (np.diff(omega) > 1e-12 * omega[1:]))
            if not split.size:
                break
            if omega.size > _MOST_SAMPLES:
                raise NotAchievableError(
                    "too many crossings to look at each",
                    where=f"up to {top:g} rad/s",
                    hint="the delays are long against the loop's fastest mode",
                )
            middle = 0.5 * (omega[split] + omega[split + 1])
            omega = np.insert(omega, split + 1, middle)
            values = np.insert(values, split + 1, self.at(middle))
        self.omega, self.values = omega, values

    def at(self, omega: Reals) -> Complexes:
        """Return L(j omega), (k,)."""
        return np.asarray(self.loop.at(1j * omega)[:, 0, 0])

    def _size(self, w: float) -> float:
        return math.log(abs(complex(self.loop.at(1j * w)[0, 0])) or 1e-300)

    def _turned(self, w: float) -> float:
        return complex(self.loop.at(1j * w)[0, 0]).imag

    def of_one(self) -> list[float]:
        """Return the frequencies [rad/s] with |L| = 1, rising."""
        with np.errstate(divide="ignore"):
            size = np.log(np.abs(self.values))
        omega = self.omega
        # an extremum between samples may cross twice
        inner = np.arange(1, size.size - 1)
        before, here, after = size[inner - 1], size[inner], size[inner + 1]
        top = (here < 0.0) & (here >= before) & (here >= after)
        bottom = (here > 0.0) & (here <= before) & (here <= after)
        peaks = inner[(np.abs(here) < _NEAR) & (top | bottom)]
        extra: list[tuple[float, float]] = []
        for k in peaks.tolist():
            sign = math.copysign(1.0, size[k])
            extremum = scipy.optimize.minimize_scalar(
                lambda w, sign=sign: sign * self._size(w),
                bounds=(omega[k - 1], omega[k + 1]),
                method="bounded",
                options={"xatol": 1e-12 * omega[k]},
            )
            if extremum.fun < 0.0:
                extra.append((float(extremum.x), sign * float(extremum.fun)))
        omega = np.append(omega, [w for w, _ in extra])
        size = np.append(size, [value for _, value in extra])
        order = np.argsort(omega, kind="stable")
        return _brackets(self._size, omega[order], size[order])

    def of_negative_axis(self) -> list[tuple[float, float]]:
        """Return (frequency, |L|) of every crossing of the negative real axis, 0 included."""
        turned = self.values.imag
        both = (self.values.real < 0.0)[:-1] | (self.values.real < 0.0)[1:]
        crossings = []
        for k in np.flatnonzero((turned[1:] * turned[:-1] < 0.0) & both).tolist():
            low, high = self.omega[k], self.omega[k + 1]
            root = scipy.optimize.brentq(self._turned, low, high, xtol=1e-300, rtol=_RELATIVE)
            value = complex(self.loop.at(1j * root)[0, 0])
            if value.real < 0.0:
                crossings.append((float(root), abs(value)))
        try:
            start = complex(self.loop.at(0.0)[0, 0])
        except np.linalg.LinAlgError:
            return crossings
        return [(0.0, -start.real), *crossings] if start.real < 0.0 else crossings

    def gain_margin(self) -> tuple[float, float]:
        """Return (factor > 1, frequency), infinite where no crossing lies inside the circle."""
        inside = [(1.0 / size, w) for w, size in self.of_negative_axis() if size < 1.0]
        return min(inside, default=(math.inf, math.nan))

    def gain_decrease(self) -> tuple[float, float]:
        """Return (factor < 1, frequency), 0 where no crossing lies outside the circle."""
        outside = [(1.0 / size, w) for w, size in self.of_negative_axis() if size > 1.0]
        return max(outside, default=(0.0, math.nan))


def _brackets(function: Any, omega: Reals, values: Reals) -> list[float]:
    """Return the zeros of a function with these values, one in every change of sign."""
    zeros = [float(w) for w in omega[values == 0.0]]
    for k in np.flatnonzero(values[1:] * values[:-1] < 0.0).tolist():
        root = scipy.optimize.brentq(function, omega[k], omega[k + 1], xtol=1e-300, rtol=_RELATIVE)
        zeros.append(float(root))
    return sorted(zeros)

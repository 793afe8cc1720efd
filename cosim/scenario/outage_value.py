"""The functional V of a proof across outages along a run, and its bound.

The bound is B, B(0) = V(0), B' = -2 alpha B or 2 beta B, + gamma |w|^2. V is computed now and then:
its integrals by the trapezoidal rule, x' as the slope of the interval, x constant before 0.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cosim import hinf

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_EARLIER = 64
"""Points that stand for the constant state before 0."""


class OutageValue:
    """V along a run, and its bound.

    Parameters
    ----------
    system : the `DelaySystem` of the proof.
    start : x(0), the state before it too.
    begin_ns, every_ns : when the run begins, and how far apart V is computed [ns].

    Attributes
    ----------
    ratio : the largest V over its bound so far, after the beginning; None where w acts and has no
        bound, or V(0) = 0 and nothing drives it.
    """

    def __init__(
        self,
        proved: hinf.certificate.Outages,
        system: Any,
        start: Reals,
        begin_ns: int,
        every_ns: int,
    ) -> None:
        self._P = _floats(proved.unknowns["P"])
        late = [delay.d for delay in system.delays if delay.d > 0]
        self._late = [
            (d, *(_floats(proved.unknowns[f"{name}[{j}]"]) for name in "SR"))
            for j, d in enumerate(late)
        ]
        self._alpha, longest = float(proved.alpha), max(late)
        self._gamma = None if proved.gamma is None else float(proved.gamma)
        self._longest, self._every_ns, self._next_ns = longest, every_ns, begin_ns
        t = begin_ns / 1e9
        self._t = np.linspace(t - longest, t, _EARLIER)
        self._x = np.tile(start, (_EARLIER, 1))
        self._bound = self._at(self._t.size - 1)
        self._known = True
        self.ratio: float | None = None

    def add(self, points: Integers, x: Reals, rates: Reals, noise: Reals) -> None:
        """Take intervals between points [ns]: x at all of them, the rate of B and |w|^2 in each."""
        if self._gamma is None and noise.any():
            self._known, self.ratio = False, None
        if not self._known:
            return
        t = points / 1e9
        first = self._t.size - 1
        self._t, self._x = np.append(self._t, t[1:]), np.concatenate([self._x, x[1:]])
        drive = (self._gamma or 0.0) * noise
        steps = zip(points[1:].tolist(), np.diff(t).tolist(), rates.tolist(), drive.tolist(),
                    strict=True)  # fmt: skip
        for k, (now, h, rate, own) in enumerate(steps, 1):
            self._bound = self._bound * math.exp(rate * h)
            self._bound += own * (math.expm1(rate * h) / rate if rate else h)
            if now < self._next_ns:
                continue
            self._next_ns = now + self._every_ns
            if self._bound > 0:
                self.ratio = max(self.ratio or 0.0, self._at(first + k) / self._bound)
        keep = int(np.searchsorted(self._t, self._t[-1] - self._longest)) - 1
        self._t, self._x = self._t[max(keep, 0) :], self._x[max(keep, 0) :]

    def _at(self, k: int) -> float:
        """Return V at the k-th point that is kept."""
        now = self._t[k]
        value = float(self._x[k] @ self._P @ self._x[k])
        for d, S, R in self._late:
            begin = max(int(np.searchsorted(self._t, now - d)) - 1, 0)
            t, x = self._t[begin : k + 1], self._x[begin : k + 1].copy()
            h, change = np.diff(t), np.diff(x, axis=0)
            span = t[1:] - np.maximum(t[:-1], now - d)
            share = (span / h)[:, None]
            middle = t[1:] - span / 2
            x[:-1] = x[1:] - change * share
            own = np.einsum("ti,ij,tj->t", x[1:], S, x[1:])
            before = np.einsum("ti,ij,tj->t", x[:-1], S, x[:-1])
            kernel = np.exp(2 * self._alpha * (t[1:] - now))
            earlier = np.exp(2 * self._alpha * (t[1:] - span - now))
            value += float((span * (own * kernel + before * earlier)).sum()) / 2
            slope = change / h[:, None]
            fast = np.einsum("ti,ij,tj->t", slope, R, slope)
            weight = np.exp(2 * self._alpha * (middle - now)) * (middle - now + d)
            value += d * float((span * fast * weight).sum())
        return value


def _floats(matrix: Any) -> Reals:
    return np.array([[float(x) for x in row] for row in matrix.tolist()])

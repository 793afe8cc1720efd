"""Method of steps for x'(t) = f(t, x(t), x(t-d_1), ..., x(t-d_m)) with zero-order hold inputs.

Classical Runge-Kutta of order four; the delayed values come from a cubic Hermite
interpolant per step. Both lose their order where a derivative of x jumps, so a step never
crosses such a point:

* an input held between communication points makes x' jump at every t_k where it changes;
* through a delay d the (m+1)-th derivative jumps at t_k + m d. A jump of the j-th
  derivative inside a step costs a local error of order h^j: m = 1 and m = 2 must be met,
  m = 3 is beyond the method's order.

With several delays the images of t_k are t_k plus all sums of at most two delays. Steps end on
t_k and on its images; each interpolant has its own one-sided slopes, since a shared slope at t_k
would smooth the jump. No step is longer than the shortest delay, or it would need values that
do not exist yet.

Halving `step` doubles the number of sub-steps in every aligned segment alike (a power of
two per segment), so that the global error falls by 16 for any delay and any communication
step. Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections.abc import Callable, Sequence
from typing import Any

Vector = list[float]
RightHandSide = Callable[[float, Vector, list[Vector]], Vector]
Piece = tuple[float, float, Vector, Vector, Vector, Vector]  # t0, t1, x0, x1, slope0, slope1

_STEP_LIMIT = 200_000  # greatest number of sub-steps in one communication step
_KEEP = 64  # unused pieces that may remain before they are deleted


class DelayLine:
    """Integrates one delay equation from communication point to communication point.

    Parameters
    ----------
    initial : x(t) for t <= start, constant history, shape (n,).
    delays : d_1 ... d_m >= 0 [s].
    step : largest internal step [s]; the step taken is the communication step (or the
        shortest delay, when that is shorter) divided by a power of two.
    start : initial time [s].

    Raises
    ------
    ValueError : a delay that is negative or not finite, a step that is not positive.
    """

    def __init__(
        self, initial: Sequence[float], delays: Sequence[float], step: float, start: float = 0.0
    ) -> None:
        for d in delays:
            if not (math.isfinite(d) and d >= 0.0):
                raise ValueError(f"a delay must be finite and not negative, got {d!r}")
        if not (math.isfinite(step) and step > 0.0):
            raise ValueError(f"the internal step must be finite and positive, got {step!r}")
        self.time = float(start)
        self.x: Vector = [float(v) for v in initial]
        self._before = list(self.x)
        self._start = self.time
        self._delays = [float(d) for d in delays]
        self._step = float(step)
        positive = sorted({d for d in self._delays if d > 0.0})
        self._shortest = positive[0] if positive else math.inf
        self._longest = positive[-1] if positive else 0.0
        self._images = sorted(set(positive) | {a + b for a in positive for b in positive})
        self._ends: list[float] = []  # t1 of every piece, for bisection
        self._pieces: list[Piece] = []
        self._breaks: list[float] = []  # images after the present time

    def at(self, t: float) -> Vector:
        """Return x(t) from the history: the constant before the start, an interpolant after it.

        Raises
        ------
        LookupError : `t` is older than the longest delay, and its piece was deleted.
        """
        if t <= self._start or not self._pieces:
            return self._before
        index = bisect_right(self._ends, t)
        if index == len(self._pieces):
            index -= 1  # t is the present, or just after it by rounding
        t0, t1, x0, x1, m0, m1 = self._pieces[index]
        if t < t0:
            raise LookupError(f"the history begins at {t0!r} s by now, asked for {t!r} s")
        h = t1 - t0
        s = (t - t0) / h
        r = 1.0 - s
        a = r * r * (1.0 + 2.0 * s)
        b = s * s * (3.0 - 2.0 * s)
        c = h * s * r * r
        e = -h * s * s * r
        return [a * p + b * q + c * u + e * v for p, q, u, v in zip(x0, x1, m0, m1, strict=True)]

    def advance(self, end: float, f: RightHandSide, *, jump: bool) -> None:
        """Integrate to `end` with the inputs inside `f` constant.

        Parameters
        ----------
        end : next communication point [s], after `time`.
        f : right-hand side of (t, x, [x(t-d_1), ..., x(t-d_m)]).
        jump : whether the inputs changed at `time`, so that images must be met.

        Raises
        ------
        ArithmeticError : the state is no longer finite.
        ValueError : `end` is not after `time`, or the delay is so much shorter than the
            communication step that there would be too many sub-steps.
        """
        begin = self.time
        if not end > begin:
            raise ValueError(f"a step must end after {begin!r} s, got {end!r} s")
        if jump or begin == self._start:
            for image in self._images:
                insort(self._breaks, begin + image)
        points = self._segment_ends(begin, end)
        longest = min(end - begin, self._shortest)
        parts = 1 << max(0, math.ceil(math.log2(longest / self._step) - 1e-9))
        if parts * len(points) > _STEP_LIMIT:
            raise ValueError(
                f"{parts * len(points)} sub-steps in one communication step of {end - begin!r} s "
                f"(delay {self._shortest!r} s, internal step {self._step!r} s); at most "
                f"{_STEP_LIMIT} are taken: use a longer step, or no delay at all"
            )
        slope = f(begin, self.x, self._lagged(begin, self.x))
        left = begin
        for right in points:
            for i in range(parts):
                t0 = left + (right - left) * i / parts
                t1 = right if i == parts - 1 else left + (right - left) * (i + 1) / parts
                slope = self._runge_kutta(t0, t1, slope, f)
            left = right
        self.time = end
        self._forget()

    def _segment_ends(self, begin: float, end: float) -> list[float]:
        """Return the ends of segments in (begin, end], none longer than the shortest delay."""
        # images that differ from each other or from the ends by rounding only are one
        near = 16.0 * math.ulp(max(1.0, abs(end)))
        ends: list[float] = []
        previous = begin
        due = bisect_right(self._breaks, end + near)
        for point in [*self._breaks[:due], end]:
            if point - previous <= near or (end - point <= near and point != end):
                continue
            parts = (point - previous) / self._shortest  # infinite for a denormal delay
            if parts > _STEP_LIMIT:
                raise ValueError(
                    f"a delay of {self._shortest!r} s divides a communication step of "
                    f"{end - begin!r} s into {parts:.3g} parts; at most {_STEP_LIMIT} are taken: "
                    "use a shorter communication step, or no delay at all"
                )
            pieces = math.ceil(parts - 1e-9)
            ends.extend(previous + (point - previous) * i / pieces for i in range(1, pieces))
            ends.append(point)
            previous = point
        del self._breaks[:due]
        return ends

    def _lagged(self, t: float, x: Vector) -> list[Vector]:
        return [self.at(t - d) if d > 0.0 else x for d in self._delays]

    def _runge_kutta(self, t0: float, t1: float, k1: Vector, f: RightHandSide) -> Vector:
        """Take one step from t0 to t1 whose first slope is known; return the slope at its end."""
        h = t1 - t0
        tm = t0 + 0.5 * h
        x0 = self.x
        n = range(len(x0))
        # with d > 0 the lagged values come from history: the two inner stages share them
        fixed = [self.at(tm - d) if d > 0.0 else None for d in self._delays]

        def lagged(x: Vector) -> list[Vector]:
            return [x if value is None else value for value in fixed]

        half = 0.5 * h
        x = [x0[i] + half * k1[i] for i in n]
        k2 = f(tm, x, lagged(x))
        x = [x0[i] + half * k2[i] for i in n]
        k3 = f(tm, x, lagged(x))
        x = [x0[i] + h * k3[i] for i in n]
        k4 = f(t1, x, self._lagged(t1, x))
        sixth = h / 6.0
        x1 = [x0[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) for i in n]
        if not all(map(math.isfinite, x1)):
            raise ArithmeticError(f"the state is no longer finite after t = {t0!r} s")
        m1 = f(t1, x1, self._lagged(t1, x1))
        self._pieces.append((t0, t1, x0, x1, k1, m1))
        self._ends.append(t1)
        self.x = x1
        return m1

    def _forget(self) -> None:
        """Delete pieces older than the longest delay, now and then."""
        # one more is kept: a lookup may fall just before the oldest time by rounding
        old = bisect_right(self._ends, self.time - self._longest) - 1
        if old > _KEEP:
            del self._ends[:old]
            del self._pieces[:old]

    def snapshot(self) -> dict[str, Any]:
        """Return the complete state as plain JSON values."""
        return {
            "time": self.time,
            "x": list(self.x),
            "before": list(self._before),
            "start": self._start,
            "pieces": [list(piece) for piece in self._pieces],
            "breaks": list(self._breaks),
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot` of a line with the same delays and step."""
        self.time = saved["time"]
        self.x = list(saved["x"])
        self._before = list(saved["before"])
        self._start = saved["start"]
        self._pieces = [
            (t0, t1, list(x0), list(x1), list(m0), list(m1))
            for t0, t1, x0, x1, m0, m1 in saved["pieces"]
        ]
        self._ends = [piece[1] for piece in self._pieces]
        self._breaks = list(saved["breaks"])

"""The H-infinity norm of a loop or system with delays: a gain that is attained, and a bound.

    G(jw) = D(jw) S(jw) C + D1,   S = H^-1,   H(s) = s I - sum_i A_i e^{-s d_i},
    D(s) = sum_i D_i e^{-s d_i},  norm = sup over w >= 0 of |G(jw)|, the largest singular value

1. From below: peaks lie near the roots, so a grid of their imaginary parts and moduli and a
   logarithmic sweep are sampled, and the highest samples refined.
2. From above, branch and bound over [0, W]. On an interval [a, b] linear interpolation of G
   and the convexity of the norm give

       |G(jw)| <= max(|G(ja)|, |G(jb)|) + (b-a)^2/8 sup |G''|,

   and sup |G''| follows from S at the midpoint c, since |H(jw) - H(jc)| <= L1 |w - c| with
   L1 = 1 + sum d_i |A_i|: no Lipschitz constant is guessed. Intervals that may contain a
   higher gain than the best one are halved; a higher sample is refined and becomes the best.
   The level-set method (Michiels, Gumussoy, SIAM J. Matrix Anal. Appl. 31, 2010) needs a
   discretised delay; this bound does not.
3. From W on, where the gain tends to |D1|, a closed form bounds it.

A system with internal delays has the norm of a loop where it, or its transpose, is one whose
disturbance acts at once (`cosim.hinf.delay_lti.retarded`). Otherwise (inputs and outputs late in
different ways, direct terms late, neutral systems) the same is done with M(s) of its blocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.hinf.delay_lti.blocks import Blocks, balanced_blocks
from cosim.hinf.delay_lti.closed_loop import ClosedLoop, checked_loop
from cosim.hinf.delay_lti.high_frequency import HighFrequency
from cosim.hinf.delay_lti.retarded import plain_of
from cosim.hinf.delay_lti.roots import Roots, characteristic_roots, is_stable, roots_of

Reals = NDArray[np.float64]

_TOLERANCE = 1e-9
_ROUNDING = float(np.finfo(np.float64).eps)
_CHUNK = 8192  # intervals examined at once: bounds the memory
_LARGEST_EFFORT = 400_000  # intervals examined in all
_REFINED = 6

ROOTS = 8
"""Number of rightmost characteristic roots near which peaks are searched."""


class NormResult(NamedTuple):
    """The norm lies between `value` and `bound`.

    value : the highest gain found; it is attained.
    frequency : where [rad/s]; infinity where it is only the limit |D1|.
    bound : no frequency has a higher gain, up to rounding. It is value (1 + 1e-9), or more
        where that would have taken more than a set number of intervals.
    """

    value: float
    frequency: float
    bound: float


def gain_at(loop: Response, omega: Any) -> Reals:
    """Return the largest singular value of G(j omega).

    Parameters
    ----------
    loop : with w and z.
    omega : frequencies [rad/s], any shape; infinity gives |D1|.

    Returns
    -------
    Gains, of the shape of `omega`.

    Raises
    ------
    InputError : the loop has no w or no z.
    """
    w = np.asarray(omega, dtype=np.float64)
    finite = np.isfinite(w)
    gains: Reals = np.linalg.norm(loop.transfer(np.where(finite, w, 0.0)), ord=2, axis=(-2, -1))
    limit = np.linalg.norm(loop.direct, 2)
    return np.asarray(np.where(finite, gains, limit), dtype=np.float64)


class _Bounds:
    """What items 2 and 3 above need of a loop."""

    def __init__(self, loop: ClosedLoop) -> None:
        D1, C = loop.direct, np.asarray(loop.C)
        delays = np.array(loop.delays)
        a = loop.sizes
        b = np.array([np.linalg.norm(D, 2) for D in loop.D])
        moments = [float(delays**k @ sizes) for sizes in (a, b) for k in (1, 2)]
        self.constants = (1.0 + moments[0], moments[1], moments[2], moments[3])
        self.direct = float(np.linalg.norm(D1, 2))
        self.a = float(a.sum())
        self.through = float(b.sum() * np.linalg.norm(C, 2))
        self.second = self.direct * b.sum() * sum(float(np.linalg.norm(A @ C, 2)) for A in loop.A)
        products = [D1.T @ D @ C for D in loop.D]
        self.first = float(np.linalg.norm(products[0] - products[0].T, 2)) + 2.0 * sum(
            float(np.linalg.norm(product, 2)) for product in products[1:]
        )

    def beyond(self, w: float) -> float:
        """Return a bound of the gain at every frequency >= w, w > sum |A_i|.

        From G'G = D1'D1 + 2 Re(D1' D S C) + (DSC)'(DSC), S = (I + S A)/(jw) and
        |S| <= 1/(w - sum |A_i|): an undelayed D enters the term in 1/w only with the
        skew-symmetric part of D1'DC, which a scalar w does not have.
        """
        rest = w - self.a
        square = self.first / w + 2.0 * self.second / (w * rest) + (self.through / rest) ** 2
        return math.sqrt(self.direct**2 + square)


def _on(loop: Response, bounds: GainBounds, low: Reals, high: Reals, ends: Reals) -> Reals:
    """Return item 2: a bound of the gain on each [low, high]; `ends`: the higher of its ends."""
    L1, L2, M1, M2 = bounds.constants
    half = 0.5 * (high - low)
    S, SC, DS = (np.linalg.norm(X, axis=(-2, -1)) for X in loop.resolvent(0.5j * (low + high)))
    rho = half * L1 * S
    grow = 1.0 / np.where(rho < 1.0, 1.0 - rho, 1.0)
    r = grow * S
    rc = grow * SC
    dr = grow * DS + half * M1 * r
    bend = rc * (M2 + 2.0 * M1 * r * L1 + dr * (2.0 * L1**2 * r + L2))
    return np.asarray(np.where(rho < 1.0, ends + 0.5 * half**2 * bend, np.inf))


def _refine(loop: Response, low: float, high: float) -> tuple[float, float]:
    """Return the highest gain near a local peak between `low` and `high`, and its frequency."""
    peak = scipy.optimize.minimize_scalar(
        lambda w: -float(gain_at(loop, w)),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-12 * high, "maxiter": 200},
    )
    return -float(peak.fun), float(peak.x)


def _higher(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Return the (gain, frequency) with the higher gain; `a` where they agree to rounding."""
    return b if b[0] > a[0] * (1.0 + 1e-14) else a


def _start(
    loop: Response, roots: Roots, bounds: GainBounds
) -> tuple[tuple[float, float], Reals, Reals]:
    """Return the best (gain, frequency) of a coarse search, and its grid and gains."""
    speeds = np.concatenate([np.abs(roots.imag), np.abs(roots)])
    sides = np.concatenate([speeds - np.abs(roots.real).min(), speeds + np.abs(roots.real).min()])
    sweep = np.geomspace(1e-3 * speeds[speeds > 0].min(), 1e2 * (bounds.a + speeds.max()), 300)
    grid = np.unique(np.abs(np.concatenate([[0.0], speeds, sides, sweep])))
    gains = gain_at(loop, grid)
    padded = np.concatenate([[-1.0], gains, [-1.0]])
    peaks = np.flatnonzero((gains >= padded[:-2]) & (gains >= padded[2:]))
    peaks = peaks[np.argsort(-gains[peaks])][:_REFINED]
    best = (bounds.direct, math.inf)
    for k in peaks.tolist():
        best = _higher(best, (float(gains[k]), float(grid[k])))
        refined = _refine(loop, float(grid[max(k - 1, 0)]), float(grid[min(k + 1, grid.size - 1)]))
        best = _higher(best, refined)
    return best, grid, gains


def _last(bounds: GainBounds, level: float, longest: float) -> float:
    """Return a frequency beyond which no gain exceeds `level`, or `longest`, by bisection."""
    low, high = bounds.a, 2.0 * bounds.a
    while high < longest and bounds.beyond(bounds.a + high) > level:
        low, high = high, 2.0 * high
    while (
        high > 1e-9 * bounds.a and low == bounds.a and bounds.beyond(bounds.a + 0.5 * high) <= level
    ):
        high *= 0.5
    return bounds.a + high


def _branch_and_bound(
    loop: Response,
    bounds: GainBounds,
    best: tuple[float, float],
    floor: float,
    points: Reals,
    values: Reals,
) -> tuple[tuple[float, float], float]:
    """Return the best (gain, frequency) over the range of `points`, and an upper bound.

    `values` are the gains at `points`, `best` the best known, `floor` an absolute tolerance.
    """
    low, high = points[:-1], points[1:]
    at_low, at_high = values[:-1], values[1:]
    bound, effort = 0.0, 0
    while low.size:
        level = best[0] * (1.0 + _TOLERANCE) + floor
        ends = np.maximum(at_low, at_high)
        chunks = [slice(i, i + _CHUNK) for i in range(0, low.size, _CHUNK)]
        upper = np.concatenate([_on(loop, bounds, low[c], high[c], ends[c]) for c in chunks])
        effort += low.size
        middle = 0.5 * (low + high)
        # Intervals left undivided by rounding or the limit of effort keep their own bound.
        final = (effort > _LARGEST_EFFORT) | (middle <= low) | (middle >= high)
        bound = max(bound, float(upper[final].max(initial=0.0)))
        divide = ~final & (upper > level)
        low, high, middle = low[divide], high[divide], middle[divide]
        at_middle = gain_at(loop, middle)
        if middle.size and at_middle.max() > best[0]:
            k = int(np.argmax(at_middle))
            best = _higher((float(at_middle[k]), float(middle[k])), best)
            best = _higher(best, _refine(loop, float(low[k]), float(high[k])))
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        at_low = np.concatenate([at_low[divide], at_middle])
        at_high = np.concatenate([at_middle, at_high[divide]])
    return best, max(bound, best[0] * (1.0 + _TOLERANCE) + floor)


def hinf_norm(loop: ClosedLoop | Blocks, roots: Roots | None = None) -> NormResult | None:
    """Compute the H-infinity norm of the nominal loop, sup over omega of |G(j omega)|.

        >>> from cosim.hinf import Delay, DelaySystem, hinf_norm
        >>> from cosim.hinf.delay_lti import close
        >>> late = Delay(0.5, feedback=True)
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]], delays=[late])
        >>> loop = close(system, [[-1.0]])
        >>> norm = hinf_norm(loop)
        >>> round(norm.value, 3), norm.value <= norm.bound < norm.value + 1e-6
        (1.111, True)
        >>> hinf_norm(close(system, [[-5.0]])) is None  # not stable
        True

    Parameters
    ----------
    loop : with w and z; or a `DelayLTI`.
    roots : its rightmost characteristic roots, `ROOTS` of them, if they are known.

    Returns
    -------
    The norm, its frequency and an upper bound, or None where the loop is not asymptotically
    stable: its rightmost characteristic root is not left of the axis, or no farther than rounding.

    Raises
    ------
    InputError : the loop has no w or no z.
    NotAchievableError : the characteristic roots could not be found (see `characteristic_roots`).
    """
    if isinstance(loop, Blocks):
        return norm_of(loop)
    checked_loop(loop)
    bounds = _Bounds(loop)
    if roots is None:
        roots = characteristic_roots(loop, ROOTS)
    if not roots[0].real < -_ROUNDING * loop.bound(0.0):
        return None
    if bounds.through == 0.0:
        return NormResult(bounds.direct, math.inf, bounds.direct)
    return norm_between(loop, bounds, roots)


class Response(Protocol):
    """A response G(j omega) whose greatest gain is searched."""

    @property
    def delays(self) -> Sequence[float] | Reals:
        """Its delays [s]."""

    @property
    def direct(self) -> NDArray[np.float64]:
        """Its value at infinite frequency, or zero where it has none."""

    def transfer(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Return G(j omega), omega.shape + (p, q)."""

    def resolvent(self, s: Any) -> tuple[Any, Any, Any]:
        """Return S = H^-1, S C and D S at s (k,), as in item 2."""


class GainBounds(Protocol):
    """Upper bounds of the gain: of `direct`, on intervals and beyond a frequency.

    constants : bounds L1, L2 of |H'|, |H''| and M1, M2 of |D'|, |D''| in item 2.
    a : frequencies above it are high; through : the size of what is not direct, times a.
    """

    constants: tuple[float, float, float, float]
    direct: float
    a: float
    through: float

    def beyond(self, w: float) -> float:
        """Return a bound of the gain at every frequency >= w, w > a."""


def norm_between(loop: Response, bounds: GainBounds, roots: Roots) -> NormResult:
    """Compute the norm of a stable response with these bounds, near whose `roots` peaks lie."""
    best, grid, gains = _start(loop, roots, bounds)
    # Absolute floor: a gain that is zero by cancellation has no relative precision.
    floor = 1e-12 * bounds.through / max(bounds.a, 1e-300)
    longest = _LARGEST_EFFORT / 4.0 / max(*loop.delays, 1e-12)
    end = _last(bounds, best[0] * (1.0 + _TOLERANCE) + floor, longest)
    inner = grid < end
    # Two points per octave above the grid: a wider interval would have no bound at first.
    last = float(grid[inner][-1]) or 0.5 * end
    above = np.geomspace(last, end, 2 + 2 * math.ceil(math.log2(end / last)))[1:]
    points = np.append(grid[inner], above)
    values = np.append(gains[inner], gain_at(loop, above))
    best, bound = _branch_and_bound(loop, bounds, best, floor, points, values)
    return NormResult(best[0], best[1], max(bound, bounds.beyond(end)))


def norm_of(blocks: Blocks) -> NormResult | None:
    """Compute the H-infinity norm, the greatest gain over all frequencies.

    Returns
    -------
    The norm, its frequency and an upper bound, or None where the system is not asymptotically
    stable.

    Raises
    ------
    InputError : no input or no output.
    NotAchievableError : characteristic roots that cannot be found.
    """
    if not blocks.D.size:
        raise InputError("this system has no gain", where="system", expected="inputs and outputs")
    if not blocks.order and not blocks.delays.size:
        gain = float(np.linalg.norm(blocks.D, 2))
        return NormResult(gain, 0.0, gain)
    roots = roots_of(blocks, ROOTS)
    if (roots.size and not roots[0].real < 0.0) or (blocks.is_neutral and not is_stable(blocks)):
        return None
    if not blocks.is_neutral and blocks.order:
        plain = plain_of(blocks)
        if plain is not None:
            return hinf_norm(plain.loop(), roots)
    high = HighFrequency(balanced_blocks(blocks)[0])
    if not roots.size:
        roots = np.array([-1.0 + 1j]) / blocks.delays.max()
    return norm_between(high.blocks, _BlockBounds(high), roots)


class _BlockBounds:
    """The same of a system with internal delays, with M for H, [B; Dv] for C, [C  Dw E] for D."""

    def __init__(self, high: HighFrequency) -> None:
        s = high.blocks
        self.high = high
        neutral = s.Dw.any() and s.Dv.any()
        self.direct = 0.0 if neutral else high.direct
        # something to measure frequencies by, also without a state
        self.a = max(high.a, float((1.0 / s.delays).max(initial=0.0)))
        self.through = max(high.through, self.a * (high.direct if neutral else 0.0))
        into = np.vstack([s.Bw, s.Dvw])

        def size(M: Reals) -> float:
            return float(np.linalg.norm(M, 2)) if M.size else 0.0

        self.constants = (
            1.0 + size(into * s.delays),
            size(into * s.delays**2),
            size(s.Dw * s.delays),
            size(s.Dw * s.delays**2),
        )

    def beyond(self, w: float) -> float:
        return self.high.beyond(w)

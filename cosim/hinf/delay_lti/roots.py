"""Characteristic roots of x' = sum_i A_i x(t-d_i) and of any system with internal delays.

1. Seeds. Eigenvalues of a collocation (`cosim.hinf.delay_lti.collocation`), more and more exact.
2. Polish. Newton for nonlinear eigenproblems by successive linear problems (Ruhe, SIAM J.
   Numer. Anal. 10, 1973): lambda -= mu, mu the smallest eigenvalue of H v = mu H' v,
   H(lambda) = lambda I - sum_i A_i e^{-lambda d_i}. Unlike the bordered iteration its steps
   stay regular at semisimple multiple roots.
3. Count. The argument principle along a vertical line left of the wanted roots counts those to
   its right. The seeds are refined until as many were found: that shows that none was missed.

Of a system with internal delays they are those of the delay differential equation that it is. A
neutral one has infinitely many near a vertical line: its roots are polished on M(s) itself, and
nothing counts them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.core import InputError, NotAchievableError
from cosim.hinf.delay_lti.blocks import Blocks, balanced_blocks
from cosim.hinf.delay_lti.closed_loop import ClosedLoop, balanced, checked_loop
from cosim.hinf.delay_lti.collocation import collocated, late_signals
from cosim.hinf.delay_lti.high_frequency import HighFrequency
from cosim.hinf.delay_lti.phase import (
    Characteristic,
    NotFollowedError,
    even_samples,
    log_derivative,
    turn_along,
)
from cosim.hinf.delay_lti.retarded import terms_of

Roots = NDArray[np.complex128]
"""Characteristic roots [1/s], rightmost first, (count,)."""

_STEPS = 60
_RESIDUAL = 1e-10
_SAME = 1e-13  # residual between two estimates of one root, however ill-conditioned
_CLOSE = 1e-4  # estimates farther apart (relative) are never one root
_FIRST_NODES = 20
_NEUTRAL_NODES = 60
_LARGEST_MATRIX = 1300
_LARGEST_EXPONENT = 200.0
_NO_DELAY = 1e-100  # of the fastest mode's time: what it adds lies beyond every number


def _polished(system: Characteristic, seeds: NDArray[Any]) -> list[complex]:
    """Return the roots that successive linear problems reach from some seeds, all at once."""
    roots, scale, longest = seeds.astype(np.complex128), system.bound(0.0), max(system.delays)
    moving = np.arange(roots.size)
    for _ in range(_STEPS):
        moving = moving[_in_range(roots[moving], longest)]
        if not moving.size:
            break
        steps = _steps(system, roots[moving])
        roots[moving] -= steps
        size = np.abs(roots[moving]) + scale
        moving = moving[~(np.abs(steps) <= 1e-15 * size)]
    roots = roots[np.isfinite(roots) & _in_range(roots, longest)]
    return [complex(root) for root in roots[_residuals(system, roots) <= _RESIDUAL]]


def _in_range(roots: Roots, longest: float) -> NDArray[np.bool_]:
    """Whether e^(-s d) of each root s is a number; not where s is NaN."""
    return -roots.real * longest < _LARGEST_EXPONENT


def _steps(system: Characteristic, roots: Roots) -> Roots:
    """Return the smallest mu of M v = mu M' v at each root; NaN where there is none."""
    M, slope = system.characteristic_matrix(roots)
    try:
        inverse = np.linalg.eigvals(np.linalg.solve(M, slope))
    except np.linalg.LinAlgError:  # one is singular, or no number: each by itself
        return np.array([_step(*pair) for pair in zip(M, slope, strict=True)])
    largest = np.abs(inverse).argmax(axis=-1)[..., None]
    with np.errstate(all="ignore"):  # of a constant M
        steps = 1.0 / np.take_along_axis(inverse, largest, -1)[..., 0]
    return np.where(np.isfinite(steps), steps, np.nan)


def _step(M: Roots, slope: Roots) -> complex:
    mu = scipy.linalg.eigvals(M, slope)
    mu = mu[np.isfinite(mu)]
    return complex(mu[np.argmin(np.abs(mu))]) if mu.size else complex(np.nan)


def _residuals(system: Characteristic, roots: Roots) -> NDArray[np.float64]:
    """Return the smallest singular value of M at each root, relative to the size of its terms."""
    M, _ = system.characteristic_matrix(roots)
    bounds = np.array([system.bound(root.real) for root in roots])
    smallest = np.linalg.svd(M, compute_uv=False)[..., -1]
    return np.asarray(smallest / (np.abs(roots) + bounds + 1e-300), dtype=np.float64)


def _same(system: Characteristic, a: complex, b: complex, scale: float) -> bool:
    """Whether `a` and `b` estimate one root: the equation holds between them as well.

    A fixed distance cannot decide: a double root is only computed to the square root of the
    precision, while two simple roots may be closer than that.
    """
    near = abs(a - b) <= _CLOSE * (abs(a) + abs(b) + scale)
    return near and bool(_residuals(system, np.array([(a + b) / 2]))[0] <= _SAME)


def _distinct(system: Characteristic, roots: list[complex]) -> Roots:
    """Return the roots in the upper half-plane, merged, rightmost first."""
    distinct: list[complex] = []
    scale = system.bound(0.0)
    for root in roots:
        real = _same(system, root, root.conjugate(), scale)
        upper = complex(root.real, 0.0 if real else abs(root.imag))
        if not any(_same(system, upper, other, scale) for other in distinct):
            distinct.append(upper)
    return np.array(sorted(distinct, key=lambda r: -r.real), dtype=np.complex128)


def _log_derivative(loop: ClosedLoop, s: Any) -> tuple[Roots, Roots]:
    """Return the phase factor f/|f| and f'/f of f = det H at the points `s`.

    Raises
    ------
    NotAchievableError : H is singular there in doubles.
    """
    try:
        return log_derivative(loop, s)
    except np.linalg.LinAlgError:
        # far to the left a late term may outweigh all others by more than doubles can tell
        raise NotAchievableError(
            "the roots of this loop cannot be counted",
            where=f"delay {loop.delays[-1]:g} s",
            expected="terms that doubles can add up",
            got="a late term that outweighs all others, or a root where none was expected",
        ) from None


def _multiplicity(loop: ClosedLoop, root: complex, radius: float) -> int:
    """Count the roots within `radius` of `root` by the argument principle on a circle."""
    turn = np.exp(2j * np.pi * (np.arange(64) + 0.5) / 64)
    _, g = _log_derivative(loop, root + radius * turn)
    return round(float(np.mean(g * radius * turn).real))


def roots_right_of(loop: ClosedLoop, real: float) -> int:
    """Count the characteristic roots with real part > `real`, with their multiplicities.

    Argument principle on the boundary of {Re s > real, |s| < R}: up the line the phase of
    f = det H is followed; on the arc, R twice the bound of all roots, it is known in closed form.

    Raises
    ------
    NotAchievableError : a root lies on the line, to rounding.
    """
    top = 2.0 * loop.bound(real) + abs(real) + 1e-300
    # Evenly against the delay, in proportion against stiff modes; the rest is refinement.
    even = even_samples(0.0, top, loop.delays[-1])
    omega = np.union1d(even, np.geomspace(1e-9 * top, top, 200))
    try:
        turn, _ = turn_along(lambda w: _log_derivative(loop, real + 1j * w), omega)
    except NotFollowedError as error:
        if error.many:
            raise NotAchievableError(
                "the delay is too long against the loop's fastest mode to count its roots",
                where=f"delay {loop.delays[-1]:g} s, rates up to {top:g} 1/s",
                hint="scale time, or leave out what is much faster than the rest",
            ) from None
        raise NotAchievableError(
            "the roots right of a line cannot be counted",
            where=f"real part {real!r}",
            expected="no root on the line",
            hint="move the line",
        ) from None
    end = real + 1j * top
    mu = np.linalg.eigvals(loop.state_matrix(end))
    arc = loop.order * np.angle(end) + float(np.angle(1.0 - mu / end).sum())
    return round(float(arc - turn) / np.pi)


def _complete(loop: ClosedLoop, upper: Roots, count: int) -> tuple[Roots, bool]:
    """Return the rightmost `count` roots found, and whether the argument principle agrees."""
    tau, scale = loop.delays[-1], loop.bound(0.0)
    width = np.where(upper.imag > 0, 2, 1)
    have = int(np.searchsorted(np.cumsum(width), min(count, int(width.sum())))) + 1
    # The line goes through the widest gap among the next few, where its phase is slow.
    last = min(have + 8, upper.size)
    left = np.append(upper.real, upper.real[-1] - 0.1 * (scale + 1.0) / (1.0 + scale * tau))
    k = have + int(np.argmax((left[:-1] - left[1:])[have - 1 : max(last - 1, have)]))
    right = upper[:k]
    everything = np.concatenate([upper, upper.conj()])
    total = 0
    for root, weight in zip(right, width[:k], strict=True):
        # Small: a neighbour that was not found must not be counted as a multiplicity.
        small = 1e-3 * (abs(root) + (1.0 / tau if tau else 0.0)) + 1e-300
        distance = np.abs(everything - root)
        nearest = float(distance[distance > 0].min(initial=scale + 1.0))
        total += int(weight) * _multiplicity(loop, complex(root), min(nearest / 4.0, small))
    line = 0.5 * (left[k - 1] + left[k])
    pairs = [[r, r.conjugate()] if r.imag else [r] for r in upper[:have]]
    roots = np.array([root for pair in pairs for root in pair], dtype=np.complex128)
    return roots, roots_right_of(loop, float(line)) == total


def approximate_roots(loop: ClosedLoop, nodes: int = _FIRST_NODES) -> Roots:
    """Return eigenvalues of the collocated generator, rightmost first: roots, not checked.

    The rightmost ones are close to characteristic roots as a rule; some may be none, or missing.
    """
    loop = ClosedLoop(balanced(loop.A), loop.delays)
    roots: Roots = np.linalg.eigvals(collocated(loop.A[0], *late_signals(loop), nodes)).astype(
        np.complex128
    )
    return roots[np.argsort(-roots.real, kind="stable")]


def characteristic_roots(loop: ClosedLoop | Blocks, count: int = 10) -> Roots:
    """Compute the rightmost characteristic roots, det(s I - sum_i A_i e^{-s d_i}) = 0.

        >>> from cosim.hinf import Delay, DelaySystem, characteristic_roots
        >>> from cosim.hinf.delay_lti import close
        >>> late = Delay(0.5, feedback=True)
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]], delays=[late])
        >>> loop = close(system, [[-1.0]])
        >>> roots = characteristic_roots(loop, 4)
        >>> roots.size, bool(roots[0].real < -1.5), bool(roots[0].imag > 0)
        (4, True, True)

    Parameters
    ----------
    loop : of a `ClosedLoop` its A and delays; or a `DelayLTI`.
    count : number of roots to find; one more if a conjugate pair is at the end, fewer if there are
        no more (n without an effective delay).

    Returns
    -------
    Distinct roots [1/s], rightmost first; of a pair, the root above the real axis comes first. Each
    satisfies the equation to a relative residual of 1e-10; a multiple root appears once.

    Raises
    ------
    InputError : `count` is less than 1.
    NotAchievableError : the roots found and the argument principle do not agree with the largest
        discretisation, or they leave the range of doubles.
    """
    if count < 1:
        raise InputError("not a number of roots", where="count", expected=">= 1", got=str(count))
    if isinstance(loop, Blocks):
        return roots_of(loop, count)
    checked_loop(loop)
    try:
        with np.errstate(all="ignore"):
            return _rightmost_roots(loop, count)
    except (ArithmeticError, ValueError) as error:  # numpy and scipy, of an infinity or a NaN
        raise NotAchievableError(
            "the characteristic roots leave the range of doubles",
            expected="rates and delays within some hundred orders of magnitude",
            got=str(error),
            hint="choose other units",
        ) from error


def _rightmost_roots(loop: ClosedLoop, count: int) -> Roots:
    """Compute what `characteristic_roots` returns."""
    loop = ClosedLoop(balanced(loop.A), loop.delays)
    tau = max((d for d, A in zip(loop.delays, loop.A, strict=True) if A.any()), default=0.0)
    if tau * loop.bound(0.0) < _NO_DELAY:
        loop = ClosedLoop([sum(loop.A, np.zeros_like(loop.A[0]))], [0.0])
        seeds = np.linalg.eigvals(loop.A[0])
        upper = _distinct(loop, [complex(seed) for seed in seeds])
        return _complete(loop, upper, count)[0]
    R, by_delay = late_signals(loop)
    # few signals allow more nodes, of which fewer are added later
    nodes, before = _FIRST_NODES * (2 if 2 * len(R) <= loop.order else 1), 0
    while True:
        matrix = collocated(loop.A[0], R, by_delay, nodes)
        seeds = np.linalg.eigvals(matrix)
        seeds = seeds[np.argsort(-seeds.real)][: 3 * count + 30 + 8 * loop.order]
        upper = _distinct(loop, _polished(loop, seeds[seeds.imag >= 0]))
        largest = 3 * matrix.shape[0] // 2 > _LARGEST_MATRIX
        if upper.size:
            try:
                roots, complete = _complete(loop, upper, count)
            except NotAchievableError:
                # few nodes miss roots: a line far to the left, with too many to count
                if largest:
                    raise
                complete = False
            if complete and (roots.size >= count or roots.size == before):
                return roots
            before = roots.size if complete else 0
        if largest:
            raise NotAchievableError(
                "the rightmost characteristic roots could not all be found",
                where=f"collocation with {nodes} nodes",
                expected="as many roots as the argument principle counts",
                hint="ask for fewer roots; the delay is long against the loop's time constants",
            )
        nodes += nodes // 2


def spectral_abscissa(loop: ClosedLoop | Blocks) -> float:
    """Compute the greatest real part of the characteristic roots [1/s]; < 0: stable.

        >>> from cosim.hinf import Delay, DelaySystem, spectral_abscissa
        >>> from cosim.hinf.delay_lti import close
        >>> late = Delay(0.5, feedback=True)
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]], delays=[late])
        >>> loop = close(system, [[-1.0]])
        >>> spectral_abscissa(loop) < -1.5, spectral_abscissa(close(system, [[-5.0]])) > 0
        (True, True)

    Raises
    ------
    InputError : neither loop nor system, or one without states.
    NotAchievableError : as `characteristic_roots`.
    """
    roots = characteristic_roots(loop, count=1)
    if not roots.size:
        raise InputError("a system without states has no roots", where="loop")
    return float(roots[0].real)


def roots_of(blocks: Blocks, count: int = 10) -> Roots:
    """Compute the rightmost characteristic roots [1/s], rightmost first.

    Returns
    -------
    As `characteristic_roots`; empty where there is neither a state nor a feedback.

    Raises
    ------
    InputError : `count` is less than 1.
    NotAchievableError : roots that cannot all be found.
    """
    if count < 1:
        raise InputError("not a number of roots", where="count", expected=">= 1", got=str(count))
    if blocks.is_neutral:
        return _neutral_roots(balanced_blocks(blocks)[0], count)
    if not blocks.order:
        return np.zeros(0, dtype=np.complex128)
    terms = [term for term in terms_of(blocks) if term.h == 0.0 or term.A.any()]
    loop = ClosedLoop([term.A for term in terms], [term.h for term in terms])
    return characteristic_roots(loop, count)


def is_stable(blocks: Blocks) -> bool:
    """Whether every characteristic root has a negative real part.

    A neutral system has roots near the lines that its difference equation v = Dvw E v has; these
    must lie left of the axis, whatever small changes of the delays (strong stability), which is
    decided by a bound: the spectral radius of |Dvw| below one.

    Raises
    ------
    NotAchievableError : roots that cannot be found, or that bound is not enough.
    """
    roots = roots_of(blocks, 4)
    if roots.size and not roots.real.max() < 0.0:
        return False
    if blocks.is_neutral and HighFrequency(blocks).through_delays is None:
        if blocks.delays.size == 1:
            return False
        raise NotAchievableError(
            "the stability of this neutral system is not decided",
            where="system",
            expected="a spectral radius of |Dvw| below one",
            got="one or more: its roots may come as near the axis as one likes",
        )
    return True


def _neutral_roots(blocks: Blocks, count: int) -> Roots:
    """Return roots near the eigenvalues of the collocated system, polished."""
    acts = np.vstack([blocks.Bw, blocks.Dvw]).any(axis=0)  # others lead to outputs alone
    from_w, delays = np.vstack([blocks.Bw, blocks.Dvw[acts]])[:, acts], blocks.delays[acts]
    by_delay = {tau: from_w * (delays == tau) for tau in set(delays.tolist())}
    seeds = np.linalg.eigvals(collocated(blocks.A, blocks.Cv[acts], by_delay, _NEUTRAL_NODES))
    seeds = seeds[seeds.imag >= 0.0]
    seeds = seeds[np.argsort(-seeds.real, kind="stable")][: 4 * count + 30]
    roots = _distinct(blocks, _polished(blocks, seeds)).tolist()
    # many lie next to one line: there the slow ones come first
    step = 0.1 / float(blocks.delays.max())
    roots.sort(key=lambda root: (-round(root.real / step), root.imag))
    pairs = [[r, r.conjugate()] if r.imag else [r] for r in roots]
    both = [root for pair in pairs for root in pair]
    end = count + (0 < count < len(both) and both[count - 1].imag > 0.0)
    return np.array(both[:end], dtype=np.complex128)

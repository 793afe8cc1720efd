"""Delay margin: the value of one delay at which a stable loop loses stability, the others kept.

A root j w of the loop at the delay tau of term k is a pair (w, theta), theta = w tau, with

    det F(w, theta) = 0,   F = j w I - sum_{i != k} A_i e^{-j w d_i} - A_k e^{-j theta},

and theta only matters modulo 2 pi. Conversely every such pair with w > 0 is a root of the loop
at tau = (theta + 2 pi m) / w, for every integer m. So all crossings for all tau lie in the box
0 < w <= sum |A_i|, 0 <= theta <= 2 pi; roots are continuous in tau and none comes in from
infinity (|s| <= sum |A_i| right of the axis), so a loop that is stable at the present delay
stays so up to the least tau of such a pair.

1. Branch and bound: at the centre of a box, |F^-1 dF| < 1 for every change dF within it shows
   that F is regular there. Boxes that are not excluded and may contain a tau below the best
   known are halved, so that no crossing is missed, however narrow.
2. Newton from the centres of what remains, with the smallest singular triplet u, sigma, v of F:
   sigma + u* F_w v dw + u* F_theta v dtheta = 0, one complex equation for two real numbers.

A root that touches the axis and returns is a pair like any other (both derivatives are then
parallel, and Newton converges linearly): asymptotic stability is lost at the touch. Pairs of
w = 0 are the loop's at every tau, and a stable loop has none with theta = 0.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import NotAchievableError
from cosim.hinf.delay_lti.closed_loop import Matrix, balanced, close, closed_terms
from cosim.hinf.delay_lti.roots import spectral_abscissa
from cosim.models import DelaySystem

Reals = NDArray[np.float64]

HORIZON = 1e4
"""Longest delay searched, in the slowest time constant of the present loop."""

_SINGULAR = 1e-14  # sigma of a root, of the size of F's terms
_TOLERANCE = 1e-9  # how far below the answer everything is excluded, relative
_COARSE = 1e-3  # the same at a touch, where excluding takes long
_SAME = 1e-6  # delays at a touch, relative
_ENOUGH = 40_000  # boxes after which the coarse tolerance applies
_LARGEST_EFFORT = 400_000
_POLISHED = 4  # boxes that Newton starts from: those of least delay, and those closest to a root
_EVERY = 4  # halvings between two such starts
_NEWTON = 20
_SETTLED = 1e-13  # the last step of Newton, relative: what is left is rounding
_FULL = 2.0 * math.pi


def delay_margin(
    system: DelaySystem, K: ArrayLike, abscissa: float | None = None
) -> tuple[float | None, ...]:
    """Compute for each delay the value at which stability is first lost, the others kept.

        >>> from cosim.hinf import Delay, DelaySystem, delay_margin
        >>> system = DelaySystem(A=[[0]], B=[[1]], delays=[Delay(0.5, feedback=True)])
        >>> [round(d, 3) for d in delay_margin(system, [[-1.0]])]  # pi / 2
        [1.571]

    All delays, also those of any age, are constants here, and the loop is the nominal one. At the
    value returned a root lies on the axis (F is within 1e-14 of singular, relative to its terms),
    and none does at shorter delays, to a relative 1e-9 (1e-3 at a touch of the axis).

    Parameters
    ----------
    system : Eq. (7) with N delays; its E, H are ignored.
    K : (m, n) state feedback.
    abscissa : spectral abscissa of the loop, if it is known.

    Returns
    -------
    N delays [s], none below the present one. None: stable for every longer delay, up to
    `HORIZON` times the slowest time constant (root, delay) of the present loop; or the present
    loop is not stable (abscissa >= 0): then all are None.

    Raises
    ------
    InputError : K does not fit.
    NotAchievableError : roots too close to the axis over too wide a range to decide, or roots
        that cannot be found.
    """
    if abscissa is None:
        abscissa = spectral_abscissa(close(system, K))
    return tuple(margin_of_delay(system, K, index, abscissa) for index in range(len(system.delays)))


def margin_of_delay(system: DelaySystem, K: ArrayLike, index: int, abscissa: float) -> float | None:
    """Compute one entry of `delay_margin`, of the delay with this index from 0.

    Raises
    ------
    InputError, NotAchievableError : as `delay_margin`.
    """
    if not abscissa < 0.0:
        return None
    A, _, delays = closed_terms(system, K)
    A = balanced(A)
    rates = sum(float(np.linalg.norm(M, 2)) for M in A)
    horizon = HORIZON * max(-1.0 / abscissa, 1.0 / rates, *delays)
    k = index + 1
    return _first_loss(_Pencil(A, delays, k, rates), delays[k], horizon)


class _Boxes(NamedTuple):
    """Boxes of (w, theta): centres and half widths."""

    w: Reals
    theta: Reals
    dw: Reals
    dtheta: Reals

    def of(self, index: Any) -> _Boxes:
        return _Boxes(*(bounds[index] for bounds in self))

    def halves(self, along_w: NDArray[np.bool_]) -> _Boxes:
        """Return both halves of each box, divided along w where `along_w`, else along theta."""
        dw = np.where(along_w, 0.5 * self.dw, self.dw)
        dtheta = np.where(along_w, self.dtheta, 0.5 * self.dtheta)
        w, theta = self.dw - dw, self.dtheta - dtheta
        return _Boxes(
            np.concatenate([self.w - w, self.w + w]),
            np.concatenate([self.theta - theta, self.theta + theta]),
            np.tile(dw, 2),
            np.tile(dtheta, 2),
        )


class _Roots(NamedTuple):
    """Pairs (w, theta) with a root on the axis, and the smallest singular value of F there."""

    w: Reals
    theta: Reals
    sigma: Reals


class _Pencil:
    """F(w, theta) for a change of delay `k` and its derivatives; `rates` bounds |sum A_i|."""

    def __init__(self, A: Sequence[Matrix], delays: Sequence[float], k: int, rates: float) -> None:
        self.rest = np.array([M for i, M in enumerate(A) if i != k])
        self.delays = np.array([d for i, d in enumerate(delays) if i != k])
        self.moved, self.rates, self.n = A[k], rates, A[k].shape[0]

    def at(self, w: Reals, theta: Reals) -> tuple[Any, Any, Any]:
        """Return F, dF/dw and dF/dtheta, each w.shape + (n, n)."""
        eye = np.eye(self.n)
        phases = np.exp(-1j * w[:, None] * self.delays)
        turned = np.exp(-1j * theta)[:, None, None] * self.moved
        F = 1j * w[:, None, None] * eye - np.einsum("wi,ijk->wjk", phases, self.rest) - turned
        by_w = 1j * (eye + np.einsum("wi,ijk->wjk", phases * self.delays, self.rest))
        return F, by_w, 1j * turned

    def change_bounds(self, boxes: _Boxes) -> tuple[Reals, Reals]:
        """Return bounds of |F^-1 dF| over each box, due to w and due to theta."""
        F, _, _ = self.at(boxes.w, boxes.theta)
        with np.errstate(all="ignore"):
            try:
                inverse = np.linalg.inv(F)
            except np.linalg.LinAlgError:
                # a box whose centre is a root must not be excluded
                F = F + 1e-14 * self.rates * np.eye(self.n)
                inverse = np.linalg.inv(F)
            by_w = np.linalg.norm(inverse, axis=(-2, -1))
            for d, M in zip(self.delays, self.rest, strict=True):
                if d > 0.0:
                    by_w = by_w + d * np.linalg.norm(inverse @ M, axis=(-2, -1))
            by_theta = np.linalg.norm(inverse @ self.moved, axis=(-2, -1))
        return boxes.dw * by_w, boxes.dtheta * by_theta

    def polished(self, boxes: _Boxes) -> _Roots:
        """Return the roots that Newton reaches from the centres of the boxes."""
        w, theta = boxes.w.copy(), boxes.theta.copy()
        moving = np.arange(w.size)
        for _ in range(_NEWTON):
            F, by_w, by_theta = self.at(w[moving], theta[moving])
            u, s, vh = np.linalg.svd(F)
            u, v, sigma = u[:, :, -1].conj(), vh[:, -1, :].conj(), s[:, -1]
            a = np.einsum("wi,wij,wj->w", u, by_w, v)
            b = np.einsum("wi,wij,wj->w", u, by_theta, v)
            # least squares: at a touch a and b are parallel
            real = np.stack([np.stack([a.real, b.real], -1), np.stack([a.imag, b.imag], -1)], -2)
            step = -sigma[:, None] * np.linalg.pinv(real, rcond=1e-12)[:, :, 0]
            w[moving] += np.clip(step[:, 0], -0.05 * self.rates, 0.05 * self.rates)
            theta[moving] += np.clip(step[:, 1], -0.3, 0.3)
            size = np.stack([np.abs(w[moving]), np.ones(moving.size)], -1)
            moving = moving[~(np.abs(step) <= _SETTLED * size).all(axis=1)]
            if not moving.size:
                break
        F, _, _ = self.at(w, theta)
        sigma = np.linalg.svd(F, compute_uv=False)[:, -1]
        size = (self.rates + w) * (1.0 + w * self.delays.max())  # of the rounding in F
        good = (sigma <= _SINGULAR * size) & (w > 1e-14 * self.rates)
        return _Roots(w[good], theta[good] % _FULL, sigma[good])


def _delays_from(d: float, roots: _Roots) -> Reals:
    """Return the least (theta + 2 pi m) / w >= d; one that is less by rounding counts as d."""
    m = np.maximum(np.ceil((d * roots.w - roots.theta) / _FULL - 1e-9), 0.0)
    at_roots: Reals = np.maximum((roots.theta + _FULL * m) / roots.w, d)
    return at_roots


def _least_delays(d: float, boxes: _Boxes) -> Reals:
    """Return a lower bound of the delays >= d of the pairs in each box."""
    low, high = np.maximum(boxes.w - boxes.dw, 0.0), boxes.w + boxes.dw
    last = boxes.theta + boxes.dtheta
    m = np.maximum(np.ceil((d * low - last) / _FULL - 1e-9), 0.0)
    least: Reals = np.maximum((boxes.theta - boxes.dtheta + _FULL * m) / high, d)
    return least


def _first_loss(pencil: _Pencil, d: float, horizon: float) -> float | None:
    """Return the least delay >= d with a root on the axis; None: none up to `horizon`."""
    if not pencil.moved.any():
        return None
    half, pi = np.array([0.5 * pencil.rates]), np.array([math.pi])
    boxes = _Boxes(half, pi, half, pi)
    losses: list[tuple[float, float]] = []  # (delay, sigma)
    best, effort = horizon, 0
    for halvings in itertools.count(1):
        by_w, by_theta = pencil.change_bounds(boxes)
        effort += boxes.w.size
        change_bounds, least = by_w + by_theta, _least_delays(d, boxes)
        left = ~(change_bounds < 1.0) & (least < best * (1.0 - _TOLERANCE))
        if not left.any():
            break
        boxes, change_bounds, least = boxes.of(left), change_bounds[left], least[left]
        if losses and effort > _ENOUGH and least.min() >= best * (1.0 - _COARSE):
            break
        if effort > _LARGEST_EFFORT:
            raise NotAchievableError(
                "the delay margin cannot be decided",
                where=f"present delay {d:g} s",
                expected="roots that cross the imaginary axis, or keep clear of it",
                got=f"a loop that comes very close to it about {boxes.w.min():g} rad/s",
            )
        if halvings % _EVERY == 0:
            closest = np.argsort(-change_bounds, kind="stable")[:_POLISHED]
            first = np.union1d(np.argsort(least, kind="stable")[:_POLISHED], closest)
            roots = pencil.polished(boxes.of(first))
            losses += zip(_delays_from(d, roots).tolist(), roots.sigma.tolist(), strict=True)
            best = min([best, *(tau for tau, _ in losses)])
        boxes = boxes.halves((by_w > by_theta)[left])
    # at a touch Newton is inexact: of equally low delays, the one closest to a root
    lowest = [(sigma, tau) for tau, sigma in losses if tau <= best * (1.0 + _SAME)]
    return min(lowest)[1] if lowest and best < horizon else None

"""Exact response in time: the method of steps with polynomials of degree 20 on every piece.

Where an input begins, or jumps, a derivative of the solution jumps, and again one delay later: one
derivative higher if a state lies between, of the same order if none does. Between these instants
the solution is an analytic function. There it is computed by collocation at the Radau points:

    x(a + c_j h) = x(a) + h sum_k a_jk (A x + B u + Bw w)(a + c_k h),  j = 1 ... 20,

an L-stable Runge-Kutta method of order 39. w is v one delay ago: the polynomial of an earlier
piece, or unknown where the piece is longer than the delay. A piece is halved until the last
coefficients of its Legendre expansion lie within rounding, so that what is left is rounding.

Instants at which only a derivative above the twelfth jumps are not met: their effect is below
that of rounding, or the piece is halved. A neutral system has all of them for ever.
"""

from __future__ import annotations

import heapq
import itertools
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from cosim.core import InputError, NotAchievableError
from cosim.hinf.delay_lti.blocks import Blocks, Reals, balanced_blocks

STAGES = 20
_LAST_JUMP = 12  # derivative
_MOST_INSTANTS = 20_000
_MOST_PIECES = 200_000
_TAIL = 1e-14  # of the last Legendre coefficients, relative
_ROUNDING = 1e4  # times that: a tail that may be rounding, if halving does not end it
_LESS = 16.0  # what halving makes of a tail that is not
_MOST_PARTS = 2**40
_PASSED = 3e-14  # of a history between two nodes, relative
_SMOOTH = 8  # coefficients whose smallness lets the next piece be longer
_NEVER = 10**6  # order of a derivative that does not jump
_NEAR = 64 * np.finfo(np.float64).eps  # instants that rounding alone separates, relative

Input = Callable[[Reals], Reals]


class Rule(NamedTuple):
    """Radau IIA on [0, 1]: nodes with 0 first, a, barycentric weights, Legendre coefficients."""

    nodes: Reals
    a: Reals
    weights: Reals
    legendre: Reals


@cache
def rule(stages: int) -> Rule:
    """Return the rule with this many stages (Hairer, Wanner, Solving ODEs II, IV.5)."""
    inner, _ = scipy.special.roots_jacobi(stages - 1, 1.0, 0.0)
    x = np.append(inner, 1.0)
    V = np.polynomial.legendre.legvander(x, stages - 1)
    # of the integral of P_k from -1: (P_{k+1} - P_{k-1}) / (2k+1), of P_0: P_1 + P_0
    above = np.polynomial.legendre.legvander(x, stages)
    integral = np.empty_like(V)
    integral[:, 0] = above[:, 1] + 1.0
    k = np.arange(1, stages)
    integral[:, 1:] = (above[:, 2:] - above[:, :-2]) / (2 * k + 1)
    a = 0.5 * np.linalg.solve(V.T, integral.T).T
    nodes = np.append(0.0, 0.5 * (x + 1.0))
    gaps = nodes[:, None] - nodes[None, :] + np.eye(nodes.size)
    logs = -np.log(np.abs(gaps)).sum(axis=1)
    weights = np.sign(gaps).prod(axis=1) * np.exp(logs - logs.max())
    everywhere = np.polynomial.legendre.legvander(2.0 * nodes - 1.0, stages)
    return Rule(nodes, a, weights, np.asarray(np.linalg.inv(everywhere), dtype=np.float64))


def interpolation(of: Rule, points: Reals) -> Reals:
    """Return the matrix (points, nodes) that evaluates a piece at points of [0, 1]."""
    gaps = points[:, None] - of.nodes[None, :]
    exact = gaps == 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = of.weights / gaps
        rows = shares / shares.sum(axis=1, keepdims=True)
    hit = exact.any(axis=1)
    rows[hit] = exact[hit]
    return np.asarray(rows, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Question:
    """What a system is asked: its input, its beginning, and until when.

    Attributes
    ----------
    columns : number of responses that are computed at once.
    input : times (k,) -> (m, k, columns), smooth after 0 but for `breaks`.
    order : derivative of the input that jumps at 0: -1 an impulse, 0 a step, 1 a ramp; None: none.
    start : x(0), (n, columns).
    before : v(t) for t < 0, a constant (N, columns).
    breaks : further instants [s] at which the input may jump.
    """

    columns: int
    input: Input
    order: int | None
    start: Reals
    before: Reals
    breaks: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class _Instant:
    """An instant at which something jumps: derivative orders of w, impulses in w and of u."""

    order_w: Reals
    impulse: Reals
    order_u: int
    impulse_u: Reals

    def with_another(self, other: _Instant) -> _Instant:
        """Return this instant and another at the same time as one."""
        return _Instant(
            np.minimum(self.order_w, other.order_w),
            self.impulse + other.impulse,
            min(self.order_u, other.order_u),
            self.impulse_u + other.impulse_u,
        )


@dataclass(frozen=True, eq=False)
class Solution:
    """Outputs as polynomials; impulses in y as (time, weight (p, columns)).

    starts, ends : (k,) of the pieces [s]; values : (k, p, nodes, columns).
    """

    starts: Reals
    ends: Reals
    values: Reals
    impulses: tuple[tuple[float, Reals], ...]
    of: Rule

    def at(self, times: Reals) -> Reals:
        """Return y at these times, (p, len(times), columns), behind a jump its right limit."""
        near = _NEAR * np.maximum(1.0, np.abs(times)) * 16.0
        index = np.searchsorted(self.starts, times + near, side="right") - 1
        index = np.clip(index, 0, self.starts.size - 1)
        h = self.ends[index] - self.starts[index]
        local = np.clip((times - self.starts[index]) / h, 0.0, 1.0)
        rows = interpolation(self.of, local)
        interpolated: Reals = np.einsum("tk,tpkc->ptc", rows, self.values[index])
        return interpolated


def solve(blocks: Blocks, asked: Question, end: float, stages: int = STAGES) -> Solution:
    """Compute the response on [0, end].

    Raises
    ------
    InputError : delays so short against `end`, or so many, that there are too many pieces.
    NotAchievableError : numbers that leave the range of doubles.
    """
    balanced, scale = balanced_blocks(blocks)
    start = asked.start / scale[:, None]
    return _Stepper(balanced, replace(asked, start=start), end, rule(stages)).run()


def _instants(blocks: Blocks, asked: Question, end: float) -> list[tuple[float, _Instant]]:
    """Return every instant in [0, end] at which a derivative up to the twelfth jumps."""
    N, m = blocks.delays.size, blocks.inputs
    instants: list[tuple[float, _Instant]] = []
    waiting: list[tuple[float, int, _Instant]] = []
    count = itertools.count()

    def add(t: float, order_u: int, order_w: Reals, impulse: Reals) -> None:
        weight = np.eye(m) if order_u == -1 and t == 0.0 else np.zeros((m, asked.columns))
        heapq.heappush(waiting, (t, next(count), _Instant(order_w, impulse, order_u, weight)))

    never = np.full(N, _NEVER)
    nothing = np.zeros((N, asked.columns))
    add(0.0, _NEVER if asked.order is None else asked.order, never, nothing)
    for t in asked.breaks:
        if 0.0 < t <= end:
            add(t, 0, never, nothing)
    # from an initial state, what the delays contained may not fit to what follows it
    for i, tau in enumerate(blocks.delays.tolist() if asked.order is None else ()):
        add(tau, _NEVER, np.where(np.arange(N) == i, 0, _NEVER), nothing)
    while waiting:
        t, _, instant = heapq.heappop(waiting)
        if t > end:
            break
        while waiting and waiting[0][0] - t <= _NEAR * max(t, 1e-300):
            instant = instant.with_another(heapq.heappop(waiting)[2])
        order_v, impulse_v = _onward(blocks, instant)
        instants.append((t, instant))
        if len(instants) > _MOST_INSTANTS:
            raise InputError(
                "too many instants at which the response is not smooth",
                where=f"the first {t:g} s of {end:g} s",
                expected=f"at most {_MOST_INSTANTS}: sums of the delays {blocks.delays.tolist()}",
                hint="a shorter time; or delays that are multiples of one",
            )
        for i in np.flatnonzero(order_v <= _LAST_JUMP).tolist():
            order_w = never.copy()
            order_w[i] = order_v[i]
            impulse = nothing.copy()
            impulse[i] = impulse_v[i]
            add(t + float(blocks.delays[i]), _NEVER, order_w, impulse)
    return instants


def _onward(blocks: Blocks, instant: _Instant) -> tuple[Reals, Reals]:
    """Return the orders and impulses of v at an instant."""

    def least(u: Reals, w: Reals) -> Reals:
        """Return the least order that comes through each row of the matrices of u and w."""
        by_u = np.where(u.any(axis=1), instant.order_u, _NEVER)
        by_w = np.where(w != 0.0, instant.order_w, _NEVER).min(axis=1, initial=_NEVER)
        return np.asarray(np.minimum(by_u, by_w))

    order_x = int(least(blocks.B, blocks.Bw).min(initial=_NEVER)) + 1
    by_x = np.where(blocks.Cv.any(axis=1), order_x, _NEVER)
    order = np.minimum(np.minimum(by_x, least(blocks.Dv, blocks.Dvw)), _NEVER)
    return order, blocks.Dv @ instant.impulse_u + blocks.Dvw @ instant.impulse


class _Stepper:
    """The pieces so far, and what makes the next one."""

    def __init__(self, blocks: Blocks, asked: Question, end: float, of: Rule) -> None:
        self.blocks, self.asked, self.of = blocks, asked, of
        self.end = end * (1.0 + 2.0**-20)  # a jump at the very end is seen from behind
        self.starts: list[float] = []
        self.ends: list[float] = []
        self.v: list[Reals] = []  # (N, nodes, columns) of each piece
        self.y: list[Reals] = []
        self.factors: dict[str, Any] = {}
        self.size = np.zeros(blocks.order + blocks.delays.size)

    def run(self) -> Solution:
        """Return all pieces."""
        instants = _instants(self.blocks, self.asked, self.end)
        x = self.asked.start
        impulses = []
        h = math.inf
        times = [t for t, _ in instants] + [self.end]
        with np.errstate(over="ignore", invalid="ignore"):
            for (t, instant), following in zip(instants, times[1:], strict=True):
                x = x + self.blocks.B @ instant.impulse_u + self.blocks.Bw @ instant.impulse
                weight = self.blocks.D @ instant.impulse_u + self.blocks.Dw @ instant.impulse
                if weight.any():
                    impulses.append((t, weight))
                x, h = self._across(t, following, x, h)
        values = np.array(self.y)
        return Solution(
            np.array(self.starts), np.array(self.ends), values, tuple(impulses), self.of
        )

    def _across(self, a: float, b: float, x: Reals, h: float) -> tuple[Reals, float]:
        """Go from a to b, where nothing jumps, with pieces of about h; return x(b) and the next h.

        Pieces are equal parts, by powers of two, so that their matrices are factored once.
        """
        parts, done, before = _parts(b - a, h), 0, math.inf
        while done < parts:
            start = a + (b - a) * done / parts
            stop = b if done + 1 == parts else a + (b - a) * (done + 1) / parts
            step = (b - a) / parts
            piece, tail, smooth = self._piece(start, step, x)
            # halving makes the tail of an analytic function vanish, and not that of rounding
            rounding = before < math.inf and tail < _ROUNDING and tail > before / _LESS
            if not (tail <= 1.0 or rounding) and parts < _MOST_PARTS:
                parts, done, before = 2 * parts, 2 * done, tail
                continue
            before = math.inf
            if not all(np.isfinite(values).all() for values in piece):
                raise NotAchievableError(
                    "the response leaves the range of doubles",
                    where=f"t = {start:g} s",
                    expected="a stable system, or a shorter time",
                )
            X, V, Y = piece
            self.starts.append(start)
            self.ends.append(stop)
            self.v.append(V)
            self.y.append(Y)
            x = X[:, -1]
            done += 1
            if smooth and done % 2 == 0 and parts > 1:
                parts, done = parts // 2, done // 2
            h = step if not smooth else 2.0 * step
            if len(self.starts) > _MOST_PIECES:
                raise InputError(
                    "too many pieces",
                    where=f"t = {start:g} s of {self.end:g} s",
                    expected=f"at most {_MOST_PIECES}",
                    hint="a shorter time; the system is fast, or its delays short, against it",
                )
        return x, h

    def _piece(
        self, a: float, h: float, x: Reals
    ) -> tuple[tuple[Reals, Reals, Reals], float, bool]:
        """Return x, v, y at the nodes of [a, a + h], their tail, and whether h may grow.

        The tail is that of `_tail`, infinite where an earlier piece was passed over.
        """
        s, nodes = self.blocks, self.of.nodes
        stages, columns = nodes.size - 1, self.asked.columns
        u = self.asked.input(a + h * nodes)
        w, inside = self._late_values(a, h)
        forced = np.einsum("nm,mkc->nkc", s.B, u) + np.einsum("nw,wkc->nkc", s.Bw, w)
        right = x[:, None] + h * np.einsum("jk,nkc->njc", self.of.a, forced[:, 1:])
        direct = np.einsum("vm,mkc->vkc", s.Dv, u) + np.einsum("vw,wkc->vkc", s.Dvw, w)
        X = np.empty((s.order, stages + 1, columns))
        X[:, 0] = x
        if not inside:
            X[:, 1:] = self._states(h, right)
        else:
            # the known parts of w act as above; the unknown ones are in the matrix
            v = self._with_channels(h, inside, x, right, direct, X)
            delayed = np.einsum("ikl,ilc->ikc", self._inside(h, inside), v)
            w = w + delayed
            direct = direct + np.einsum("vw,wkc->vkc", s.Dvw, delayed)
        V = np.einsum("vn,nkc->vkc", s.Cv, X) + direct
        Y = np.einsum("pn,nkc->pkc", s.C, X) + np.einsum("pw,wkc->pkc", s.Dw, w)
        Y += np.einsum("pm,mkc->pkc", s.D, u)
        tail, smooth = self._tail(np.concatenate([X, V]), h)
        if tail < _ROUNDING and not self._follows_history(a, h, w):
            tail = math.inf
        return (X, V, Y), tail, smooth

    def _follows_history(self, a: float, h: float, w: Reals) -> bool:
        """Whether w between its nodes is what the pieces before were: none was passed over.

        A boundary layer of an earlier piece may lie between two nodes of this one.
        """
        for i, tau in enumerate(self.blocks.delays.tolist()):
            first = max(bisect_right(self.starts, a - tau) - 1, 0)
            last = bisect_left(self.starts, min(a, a - tau + h) * (1.0 - 1e-12))
            if last - first < 2:
                continue
            middles = 0.5 * (np.array(self.starts[first:last]) + np.array(self.ends[first:last]))
            middles = middles[(middles > a - tau) & (middles < a - tau + h)]
            if not middles.size:
                continue
            known = self._history(i, middles, middles)
            computed = interpolation(self.of, (middles - (a - tau)) / h) @ w[i]
            allowed = _PASSED * max(self.size[self.blocks.order + i], float(np.abs(known).max()))
            if not np.abs(computed - known).max() <= allowed:
                return False
        return True

    def _tail(self, values: Reals, h: float) -> tuple[float, bool]:
        """Return the last Legendre coefficients against rounding, and if the last eight are less.

        Not finite values give an infinite tail.
        """
        s = self.blocks
        sizes = np.abs(values).max(axis=(1, 2), initial=0.0)
        size = np.maximum(self.size, sizes)
        n = s.order
        # what rounds a row is the size of its terms, not of their sum
        terms = np.concatenate(
            [
                h * (np.abs(s.A) @ size[:n] + np.abs(s.Bw) @ size[n:]),
                np.abs(s.Cv) @ size[:n] + np.abs(s.Dvw) @ size[n:],
            ]
        )
        allowed = _TAIL * np.maximum(np.maximum(size, terms), 1e-300)[:, None]
        coefficients = np.abs(np.einsum("jk,rkc->rjc", self.of.legendre, values)).max(axis=2)
        shares = coefficients / allowed
        tail = float(shares[:, -2:].max(initial=0.0))
        if not math.isfinite(tail):
            return math.inf, False
        if tail <= 1.0:
            self.size = size
        return tail, bool((shares[:, -_SMOOTH:] <= 1.0).all())

    def _states(self, h: float, right: Reals) -> Reals:
        """Solve x - h a (A x) = right at the stages."""
        n, stages = self.blocks.order, right.shape[1]
        if not n:
            return right
        key = f"{h:.14e}"
        if key not in self.factors:
            matrix = np.eye(n * stages) - float(key) * np.kron(self.blocks.A, self.of.a)
            self.factors[key] = scipy.linalg.lu_factor(matrix, check_finite=False)
        states_at = scipy.linalg.lu_solve(
            self.factors[key], right.reshape(n * stages, -1), check_finite=False
        )
        return np.asarray(states_at).reshape(right.shape)

    def _late_values(self, a: float, h: float) -> tuple[Reals, tuple[int, ...]]:
        """Return w at the nodes as far as it is known, and the channels that look into the piece.

        Of those, what lies before the piece is in w, and the rest zero.
        """
        s, nodes, columns = self.blocks, self.of.nodes, self.asked.columns
        w = np.zeros((s.delays.size, nodes.size, columns))
        inside = []
        for i, tau in enumerate(s.delays.tolist()):
            known = nodes.size
            if tau < h * (1.0 - 1e-9):
                inside.append(i)
                known = int((nodes * h < tau).sum())
            points = a - tau + h * nodes[:known]
            # on which side of a jump a point lies is decided from within the piece
            middle = a - tau + 0.5 * min(h, tau)
            w[i, :known] = self._history(i, points, points + 1e-7 * (middle - points))
        return w, tuple(inside)

    def _history(self, i: int, points: Reals, within: Reals) -> Reals:
        """Return v_i at the points, (len(points), columns), in the pieces that hold `within`."""
        values = np.empty((points.size, self.asked.columns))
        before = within < 0.0
        values[before] = self.asked.before[i]
        if before.all():
            return values
        index = np.searchsorted(self.starts, within, side="right") - 1
        for k in np.unique(index[~before]).tolist():
            chosen = (index == k) & ~before
            start, stop = self.starts[k], self.ends[k]
            local = (points[chosen] - start) / (stop - start)
            values[chosen] = interpolation(self.of, local) @ self.v[k][i]
        return values

    def _inside(self, h: float, inside: tuple[int, ...]) -> Reals:
        """Return, per channel, the matrix (nodes, nodes) of w_i from v_i of the same piece."""
        nodes = self.of.nodes
        rows = np.zeros((self.blocks.delays.size, nodes.size, nodes.size))
        for i in inside:
            share = nodes - self.blocks.delays[i] / h
            past = ~(nodes * h < self.blocks.delays[i])
            rows[i, past] = interpolation(self.of, share[past])
        return rows

    def _with_channels(
        self, h: float, inside: tuple[int, ...], x: Reals, right: Reals, direct: Reals, X: Reals
    ) -> Reals:
        """Solve for x at the stages, into X, and v at the nodes where it acts late in the piece.

        x - h a (A x + Bw L v) = right, v - Dvw L v = Cv x + direct, L the matrices of `_inside`.
        v is substituted: it may be far larger than x, whose digits would be lost beside it.
        """
        s = self.blocks
        n, N, stages, columns = s.order, s.delays.size, *right.shape[1:]
        L = self._inside(h, inside)
        key = f"late {h:.14e}"
        if key not in self.factors:
            loop = np.eye(N * stages) - np.einsum("vw,wkl->vkwl", s.Dvw, L[:, 1:, 1:]).reshape(
                N * stages, -1
            )
            into = h * np.einsum("nw,jk,wkl->njwl", s.Bw, self.of.a, L[:, 1:, 1:])
            through = np.linalg.solve(loop.T, into.reshape(n * stages, -1).T).T
            matrix = np.eye(n * stages) - h * np.kron(s.A, self.of.a)
            matrix -= through @ np.kron(s.Cv, np.eye(stages))
            states = scipy.linalg.lu_factor(matrix, check_finite=False)
            self.factors[key] = (states, through, np.linalg.inv(loop))
        states, through, channels = self.factors[key]
        v0 = s.Cv @ x + direct[:, 0]
        first = np.einsum("wk,wc->wkc", L[:, 1:, 0], v0)
        right = right + h * np.einsum("jk,nw,wkc->njc", self.of.a, s.Bw, first)
        direct = direct[:, 1:] + np.einsum("vw,wkc->vkc", s.Dvw, first)
        flat = direct.reshape(N * stages, columns)
        known = right.reshape(n * stages, columns) + through @ flat
        late_outputs = np.asarray(scipy.linalg.lu_solve(states, known, check_finite=False))
        X[:, 1:] = late_outputs.reshape(n, stages, columns)
        signals = np.einsum("vn,nkc->vkc", s.Cv, X[:, 1:]).reshape(N * stages, columns) + flat
        v = (channels @ signals).reshape(N, stages, columns)
        return np.concatenate([v0[:, None], v], axis=1)


def _parts(length: float, h: float) -> int:
    """Return the power of two of parts of `length` that are about h."""
    if not h < length:
        return 1
    return int(2 ** math.ceil(math.log2(length / h) - 1e-9))

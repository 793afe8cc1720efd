"""The functions of K that a descent makes small, with their gradients.

The loop is that of Eq. (7) with u = K sum_i S_i x(t-d_i), the delays taken as constants:

    phi(s) = sum_i S_i e^{-s d_i},  H(s) = s I - sum_i A_i e^{-s d_i} - B K phi(s)

(K o phi(s) for K phi(s), phi = sum_i M_i e^{-s d_i}, where the feedback is by entry of K.)

**Abscissa.** For a simple root s with left and right null vectors u, v of H(s),

    ds = u* B dK phi(s) v / (u* H'(s) v).

**Excess.** For a damping ratio zeta of every root with Re s >= -sigma: the greatest, over the
roots, of the lesser of zeta + Re s/|s| and 1 + Re s/sigma. It is negative where all are damped so.

**Gain.** F enters through p = F q. With the transfer functions G_z, G_q from (w, p) to z and q,
and a scaling e_i > 0 for each block of F as in the LMI (eps_i = gamma e_i^2; L_p and L_q have e_i^2
on the columns of E and the rows of H of block i), no F with F'F <= I makes the gain exceed g where

    G_z* G_z <= g^2 N,   N = diag(I, L_p) - G_q* L_q G_q > 0     at every frequency.

The least g at one frequency is a generalised eigenvalue; at its vector v, with a = G_z v,
b = G_q v, x = H^-1 (C E) v and the row l = a*(D2 + D_z H^-1 B) + g^2 b* L_q H_q H^-1 B,

    d(g^2) (v*N v) = 2 Re(l dK phi x) - 2 g^2 sum_i e_i^2 (|v_pi|^2 - |b_i|^2) d(log e_i).

**Uncertainty alone.** N > 0 at some gain asks for |L_q^1/2 G_qp L_p^-1/2| < 1; at its singular
vectors u, v the logarithm changes by (|u_i|^2 - |v_i|^2) d(log e_i). One block needs no scaling.

Without uncertainty g is the largest singular value. A maximum over frequencies has the gradient
at its peak: the function has a kink where two peaks are equal. Where a delay varies, the loop is
taken at its least and at its greatest age: a gain that is found here is a proposal, not a proof.
"""

from __future__ import annotations

import itertools
from copy import copy
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cosim.hinf.delay_lti import ClosedLoop, approximate_roots
from cosim.models import DelaySystem, Matrix

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_NODES = 14  # of the collocation: enough for the rightmost roots of a loop near stability
_SWEEP = 40  # frequencies of the coarse sweep
_PEAKS = 3
_ROUNDS, _POINTS = 6, 9  # of the refinement: each round shrinks an interval to a quarter
_ROUNDS_OF_ALL = 2  # after which the highest peak alone is refined
_WIDEST = 100.0  # |log e| that a line search may try: further away e overflows
_POLISH = 3  # Newton steps for a root
_AT_ZERO = 1e-9  # of `within`: a root nearer to 0 is taken to be at this distance
_LEAST_PATH = 1e-3  # of the greatest gain between blocks of F: keeps their matrix positive
_MORE_NODES, _WORST = 20, 4  # for roots further to the left; how many of them are polished


class Value(NamedTuple):
    """A function of K and log e, with its derivatives.

    value : infinite where the loop is not stable, or not with every F at this e.
    in_gain : (m, n) by K.
    in_scaling : (blocks,) by log e; zero where it has no part in the value.
    in_disturbance : (n, q) by the disturbance matrix C, where a loop asks for it.
    """

    value: float
    in_gain: Matrix
    in_scaling: Reals
    in_disturbance: Matrix | None = None


class _At(NamedTuple):
    """The loop at some values of s, one per entry of the first axis."""

    phi: Complexes  # (.., 1 or m, n)
    inverse: Complexes  # (.., n, n) H^-1
    on_output: Complexes  # (.., p, n) D_z
    on_uncertain: Complexes  # (.., r, n) H_q


class _Brief(NamedTuple):
    """A loop whose uncertain signals are scaled, and no more than the states: C, E, D, H."""

    C: Matrix
    E: Matrix
    D: Reals
    H: Reals


class GainFunction(Protocol):
    """What a descent makes small: functions of a matrix of unknowns, such as `LoopGain` of K."""

    scalings: int
    free: NDArray[np.bool_]
    has_gain: bool
    has_scaling: bool

    def abscissa(self, K: Matrix) -> Value:
        """Return the greatest real part of the characteristic roots."""

    def gain(self, K: Matrix, log_e: float | Reals = 0.0) -> Value:
        """Return the logarithm of the gain at scalings e."""

    def excess(self, K: Matrix, ratio: float, within: float) -> Value:
        """Return by how much a root misses a damping ratio."""

    def balanced(self, K: Matrix) -> Reals:
        """Return scalings log e at which the gain from p to q is lower, for a search to start."""


class LoopGain:
    """The abscissa and the gain of one system's loop as functions of K.

    Parameters
    ----------
    system : Eq. (7) (n states, m inputs).
    uncertain : False: F = 0.
    only_uncertain : the gain is that from p to q, scaled, which must be less than one.
    by_disturbance : also differentiate by the disturbance matrix C, which may be set then.
    in_parts : compute roots in the parts that the loop falls into, one behind the other; a pair
        does, into the plant and the error, each again where states do not act on each other.

    Attributes
    ----------
    scalings : how many there are: one per block of F, one where nothing is uncertain.
    free : (m, n) whether an entry of K may differ from zero.
    has_gain : whether there is a gain to make small.
    """

    def __init__(
        self,
        system: DelaySystem,
        *,
        uncertain: bool = True,
        only_uncertain: bool = False,
        by_disturbance: bool = False,
        in_parts: bool = False,
    ) -> None:
        self.system = system
        self._by_disturbance, self._in_parts = by_disturbance, in_parts
        self.free = system.free
        self._known_parts: dict[tuple[str, bytes], list[NDArray[np.intp]]] = {}
        # (N+1, 1, n), or (N+1, m, n) where entries of K act through different delays
        self._S = np.array([np.atleast_2d(S) for S in system.selections])
        self._A = np.array([system.A, *(delay.A for delay in system.delays)])
        self._B = system.B
        H = np.array([system.H, *(delay.H for delay in system.delays)])
        D = np.array([system.D, *(np.zeros_like(system.D) for _ in system.delays)])
        if only_uncertain:
            # as if p were w and q were z
            self._C, self._D, self._D1 = system.E, H, np.zeros((len(system.H), system.E.shape[1]))
            self._D2 = np.zeros((len(system.H), system.B.shape[1]))
            self._E, self._H = system.E[:, :0], H[:, :0]
        else:
            self._C, self._D, self._D1, self._D2 = system.C, D, system.D1, system.D2
            self._E, self._H = system.E, H
            if not uncertain:
                self._E, self._H = system.E[:, :0], H[:, :0]
        blocks = system.blocks
        self.scalings = max(1, len(blocks))
        self._blocks = blocks if self._E.size else ()
        # of the gain from p to q; a single block needs none
        self._scaled_alone = blocks if only_uncertain and len(blocks) > 1 else ()
        self.has_gain = bool(self._C.size and self._D[0].size)
        self.has_scaling = bool(self._E.size) and self.has_gain
        greatest = [delay.constant_age for delay in system.delays]
        least = [x.least_age if x.any_age else x.d for x in system.delays]
        # the constant ages at which the loop is taken
        self._ages = [np.array([0.0, *greatest])]
        if least != greatest:
            self._ages.append(np.array([0.0, *least]))

    def with_disturbance(self, C: Matrix) -> LoopGain:
        """Return the same loop with the disturbance matrix C (n, q)."""
        other = copy(self)
        other._C = C  # noqa: SLF001 - its own copy
        return other

    def abscissa(self, K: Matrix) -> Value:
        """Return the greatest real part of the characteristic roots [1/s], computed roughly."""
        return max((self._abscissa_at(K, ages) for ages in self._ages), key=lambda x: x.value)

    def gain(self, K: Matrix, log_e: float | Reals = 0.0) -> Value:
        """Return log g at the scalings e; infinite where the loop or N is not as it must be.

        log_e : one number per block of F, or one for all.
        """
        log_e = np.broadcast_to(np.asarray(log_e, dtype=np.float64), (self.scalings,))
        gains: list[Value] = []
        for ages in self._ages:
            gains.append(self._gain_at(K, log_e, ages))
            if not np.isfinite(gains[-1].value):
                return gains[-1]
        return max(gains, key=lambda x: x.value)

    def excess(self, K: Matrix, ratio: float, within: float) -> Value:
        """Return by how much the damping of a root of the nominal loop misses `ratio`.

        within : how far to the left roots count [1/s]; ages are constant, the greatest.
        """
        ages = self._ages[0]
        roots = self._roots(K, ages, _MORE_NODES)
        worst = np.argsort(-_excess(roots, ratio, within), kind="stable")[:_WORST]
        polished = np.array([self._polished(K, complex(s), ages) for s in roots[worst]])
        values = _excess(polished, ratio, within)
        s, value = complex(polished[values.argmax()]), float(values.max())
        slope, size = self._root_slope(K, s, ages), abs(s) + _AT_ZERO * within
        gradient = slope.real / within
        if value < 1 + s.real / within:
            turned = s.conjugate() / size * slope
            gradient = (slope.real - s.real / size * turned.real) / size
        return Value(value, np.asarray(gradient * self.free), np.zeros(self.scalings))

    def balanced(self, K: Matrix) -> Reals:
        """Return log e by the Perron vectors of the greatest gains from block to block of F.

        With |N_ij| of these gains, the scaling e_i^2 = l_i / r_i of its left and right Perron
        vectors has the least norm of all (Stoer, Witzgall, Numer. Math. 4, 1962).
        """
        peaks = np.zeros((self.scalings, self.scalings))
        for ages in self._ages:
            grid = self._grid(self._roots(K, ages))
            at, x = self._maps(K, np.zeros(self.scalings), grid, ages)
            q = np.abs(at.on_output @ x)
            for (i, (_, rows)), (j, (columns, _)) in itertools.product(
                enumerate(self._scaled_alone), repeat=2
            ):
                sizes = np.linalg.norm(q[:, rows, columns], axis=(1, 2))
                peaks[i, j] = max(peaks[i, j], float(sizes.max()))
        peaks += _LEAST_PATH * peaks.max()
        left, right = (_perron(M) for M in (peaks.T, peaks))
        return np.asarray(0.5 * np.log(left / right))

    def _roots(self, K: Matrix, ages: Reals, nodes: int = _NODES) -> Complexes:
        A = [M + _fed(self._B, K, S) for M, S in zip(self._A, self._S, strict=True)]
        if not self._in_parts:
            return approximate_roots(ClosedLoop(A, ages.tolist()), nodes)
        all_roots = []
        for part in self._parts(np.abs(A).sum(axis=0), "strong"):
            part_of_A = [M[np.ix_(part, part)] for M in A]
            acting = [
                k for k, M in enumerate(part_of_A) if k == 0 or M.any()
            ]  # without the others: smaller
            inner = ClosedLoop([part_of_A[k] for k in acting], ages[acting].tolist())
            all_roots.append(approximate_roots(inner, nodes))
        roots = np.concatenate(all_roots)
        return np.asarray(roots[np.argsort(-roots.real, kind="stable")])

    def _parts(
        self, pattern: Matrix, connection: Literal["strong", "weak"]
    ) -> list[NDArray[np.intp]]:
        """Return the states of each part that a pattern of entries falls into."""
        key = connection, (pattern > 0).tobytes()
        if key not in self._known_parts:
            count, label = connected_components(pattern > 0, connection=connection)
            self._known_parts[key] = [np.flatnonzero(label == k) for k in range(count)]
        return self._known_parts[key]

    def _at(self, K: Matrix, s: Any, ages: Reals) -> tuple[Any, Any, Any]:
        """Return the weights e^{-s d_i}, phi and H at each s."""
        weights = np.exp(-s[:, None] * ages)
        phi = (weights @ self._S.reshape(len(self._S), -1)).reshape(-1, *self._S.shape[1:])
        A = np.einsum("ki,iab->kab", weights, self._A)
        H = s[:, None, None] * np.eye(len(self._B)) - A - _fed(self._B, K, phi)
        return weights, phi, H

    def _abscissa_at(self, K: Matrix, ages: Reals) -> Value:
        root = self._polished(K, complex(self._roots(K, ages)[0]), ages)
        slope = self._root_slope(K, root, ages).real * self.free
        return Value(root.real, np.asarray(slope), np.zeros(self.scalings))

    def _polished(self, K: Matrix, root: complex, ages: Reals) -> complex:
        """Return the root near an approximate one."""
        for _ in range(_POLISH):
            _, _, H = self._at(K, np.array([root]), ages)
            mu = scipy.linalg.eigvals(H[0], self._derivative(K, root, ages))
            mu = mu[np.isfinite(mu)]
            step = complex(mu[np.argmin(np.abs(mu))]) if mu.size else 0.0
            if abs(step) > 0.1 * (abs(root) + 1.0):
                break  # another root: the seed was a poor one
            root -= step
        return root

    def _root_slope(self, K: Matrix, root: complex, ages: Reals) -> Complexes:
        """Return the derivative (m, n) of a root by the entries of K; zero at a multiple one."""
        _, phi, H = self._at(K, np.array([root]), ages)
        left, _, right = np.linalg.svd(H[0])
        u, v = left[:, -1].conj(), right[-1].conj()
        slope = u @ self._derivative(K, root, ages) @ v
        if not slope:
            return np.zeros(K.shape, complex)
        return np.asarray((u @ self._B)[:, None] * (phi[0] * v) / slope)

    def _derivative(self, K: Matrix, s: complex, ages: Reals) -> Complexes:
        """Return H'(s)."""
        weights = ages * np.exp(-s * ages)
        phi = (weights @ self._S.reshape(len(self._S), -1)).reshape(self._S.shape[1:])
        delayed = np.einsum("i,iab->ab", weights, self._A) + _fed(self._B, K, phi)
        return np.asarray(np.eye(len(self._B)) + delayed, dtype=np.complex128)

    def _gain_at(self, K: Matrix, log_e: Reals, ages: Reals) -> Value:
        nothing = Value(np.inf, np.zeros(K.shape), np.zeros(self.scalings))
        if np.abs(log_e).max() > _WIDEST:
            return nothing
        roots = self._roots(K, ages)
        if not roots[0].real < 0:
            return nothing
        floor = float(np.linalg.norm(self._D1, 2)) if self._D1.size else 0.0
        grid = self._grid(roots)
        brief = self._in_brief(log_e)
        levels = self._levels(K, brief, grid, ages)
        if not np.isfinite(levels).all():
            return nothing
        padded = np.concatenate([[-np.inf], levels, [-np.inf]])
        peaks = np.flatnonzero((levels >= padded[:-2]) & (levels >= padded[2:]))
        peaks = peaks[np.argsort(-levels[peaks], kind="stable")][:_PEAKS]
        low, high = grid[np.maximum(peaks - 1, 0)], grid[np.minimum(peaks + 1, grid.size - 1)]
        best, at = float(levels[peaks[0]]), float(grid[peaks[0]])
        share = np.linspace(0.0, 1.0, _POINTS)
        for each in range(_ROUNDS):
            inner = low[:, None] + (high - low)[:, None] * share
            at_points = self._levels(K, brief, inner.ravel(), ages).reshape(inner.shape)
            if not np.isfinite(at_points).all():
                return nothing
            top = at_points.argmax(axis=1)
            rows = np.arange(len(top))
            first = int(at_points[rows, top].argmax())
            if at_points.max() > best:
                best, at = float(at_points[first, top[first]]), float(inner[first, top[first]])
            if each == _ROUNDS_OF_ALL:
                rows = rows[first : first + 1]
            low = inner[rows, np.maximum(top[rows] - 1, 0)]
            high = inner[rows, np.minimum(top[rows] + 1, _POINTS - 1)]
        if not best > floor:
            # the limit of high frequencies, which no gain changes
            return nothing._replace(value=float(np.log(max(floor, 1e-300))))
        return self._slopes(K, log_e, at, ages)

    def _grid(self, roots: Complexes) -> Reals:
        """Return the frequencies of a coarse search: a sweep, and those near roots."""
        near = roots[np.abs(roots.real) < 20 * np.abs(roots[0].real) + np.abs(roots[0])]
        near = near[near.imag >= 0][:40]
        speeds = np.concatenate([near.imag, np.abs(near)])
        slow = max(float(np.abs(roots).min()), 1e-12)
        fast = 10 * max(float(np.linalg.norm(self._A, 2, axis=(1, 2)).sum()), float(speeds.max()))
        sweep = np.geomspace(1e-2 * slow, max(fast, 2e-2 * slow), _SWEEP)
        return np.unique(np.concatenate([[0.0], speeds, sweep]))

    def _maps(self, K: Matrix, log_e: Reals, omega: Reals, ages: Reals) -> tuple[_At, Any]:
        weights, phi, H = self._at(K, 1j * omega, ages)
        D = np.einsum("ki,iab->kab", weights, self._D) + _fed(self._D2, K, phi)
        q = np.einsum("ki,iab->kab", weights, self._H)
        inverse = self._inverse(H)
        x = inverse @ np.hstack([self._C, self._E])
        for (columns, rows), e in zip(self._scaled_alone, np.exp(log_e), strict=False):
            D[:, rows] *= e
            x[:, :, columns] /= e
        return _At(phi, inverse, D, q), x

    def _inverse(self, H: Complexes) -> Complexes:
        """Return H^-1, by the parts that do not act on each other."""
        if not self._in_parts:
            return np.asarray(np.linalg.inv(H))
        inverse = np.zeros_like(H)
        for part in self._parts(np.abs(H).sum(axis=0), "weak"):
            at = (slice(None), part[:, None], part)
            inverse[at] = np.linalg.inv(H[at])
        return inverse

    def _in_brief(self, log_e: Reals) -> _Brief:
        """Return what F connects at these scalings in as few signals as there are states.

        The least p*L_p p with E p = f is that of f in the directions of a triangle of E L_p^-1/2;
        so too q*L_q q in those of a triangle of L_q^1/2 H.
        """
        blocks = self._blocks or self._scaled_alone
        if not blocks:
            return _Brief(self._C, self._E, self._D, self._H)
        columns, rows = (
            np.repeat(np.exp(log_e), [x.stop - x.start for x in block])
            for block in zip(*blocks, strict=True)
        )
        E, H = (self._E, self._H) if self._blocks else (self._C, self._D)
        into = _triangle((E / columns).T).T
        out = _triangle(np.hstack(list(H * rows[:, None])))
        out = out.reshape(len(out), len(H), -1).swapaxes(0, 1)
        if self._blocks:
            return _Brief(self._C, into, self._D, out)
        return _Brief(into, self._E, out, self._H)

    def _levels(self, K: Matrix, brief: _Brief, omega: Reals, ages: Reals) -> Reals:
        """Return the least g at every frequency; infinite where N is not positive."""
        weights, phi, H = self._at(K, 1j * omega, ages)
        x = self._inverse(H) @ np.hstack([brief.C, brief.E])
        z = np.einsum("ki,iab->kab", weights, brief.D)
        if self._D2.any():
            z = z + _fed(self._D2, K, phi)
        z = z @ x
        if self._D1.any():
            z[:, :, : self._D1.shape[1]] += self._D1
        if brief.E.size:
            q = np.einsum("ki,iab->kab", weights, brief.H) @ x
            N = np.eye(x.shape[2]) - q.conj().swapaxes(1, 2) @ q
            try:
                lower = np.linalg.cholesky(N)
            except np.linalg.LinAlgError:
                return np.full(omega.shape, np.inf)
            z = np.linalg.solve(lower, z.conj().swapaxes(1, 2))
        if z.shape[1] > z.shape[2]:
            z = z.conj().swapaxes(1, 2)
        square = np.linalg.eigvalsh(z @ z.conj().swapaxes(1, 2))[:, -1]
        return np.asarray(np.sqrt(np.maximum(square, 0.0)), dtype=np.float64)

    def _slopes(self, K: Matrix, log_e: Reals, omega: float, ages: Reals) -> Value:
        """Return log g at one frequency, with its derivatives."""
        maps, states = self._maps(K, log_e, np.array([omega]), ages)
        at, x = _At(*(values[0] for values in maps)), states[0]
        z, q = at.on_output @ x, at.on_uncertain @ x
        z[:, : self._D1.shape[1]] += self._D1
        square, v = self._least(z, q, log_e)
        square = square**2
        a, b, v_p = z @ v, q @ v, v[self._C.shape[1] :]
        size = float((self._weight(log_e) * np.abs(v) ** 2).sum())
        through = at.inverse @ self._B
        row, on_q = a.conj() @ (self._D2 + at.on_output @ through), at.on_uncertain @ through
        slope = np.zeros(self.scalings)
        for i, (p, h) in enumerate(self._blocks):
            e2 = float(np.exp(2 * log_e[i]))
            energy = np.vdot(b[h], b[h]).real
            size -= float(e2 * energy)
            row = row + square * e2 * b[h].conj() @ on_q[h]
            slope[i] = -2 * square * e2 * float(np.vdot(v_p[p], v_p[p]).real - energy)
        for i, (p, h) in enumerate(self._scaled_alone):
            slope[i] = 2 * float(np.vdot(a[h], a[h]).real - square * np.vdot(v[p], v[p]).real)
        in_disturbance = None
        if self._by_disturbance:
            before = a.conj() @ at.on_output
            for i, (_, h) in enumerate(self._blocks):
                before = before + square * np.exp(2 * log_e[i]) * b[h].conj() @ at.on_uncertain[h]
            by_C = np.outer(before @ at.inverse, v[: self._C.shape[1]]).real
            in_disturbance = by_C / size / square
        gradient = 2 * (row[:, None] * (at.phi * (x @ v))).real * self.free / size
        return Value(
            *(0.5 * float(np.log(square)), gradient / (2 * square), slope / size / (2 * square)),
            in_disturbance,
        )

    def _weight(self, log_e: Reals) -> Reals:
        """Return the diagonal of diag(I, L_p)."""
        weight = np.ones(self._C.shape[1] + self._E.shape[1])
        for (columns, _), e in zip(self._blocks, log_e, strict=False):
            weight[self._C.shape[1] :][columns] = float(np.exp(2 * e))
        return weight

    def _scaled(self, q: Complexes, log_e: Reals) -> Complexes:
        """Return N for G_q."""
        N: Any = np.diag(self._weight(log_e))
        if not self._blocks:
            return np.asarray(N)
        if len(self._blocks) == 1:
            return np.asarray(N - float(np.exp(2 * log_e[0])) * (q.conj().swapaxes(-1, -2) @ q))
        sizes = np.repeat(np.exp(log_e), [rows.stop - rows.start for _, rows in self._blocks])
        scaled = sizes[:, None] * q
        return np.asarray(N - scaled.conj().swapaxes(-1, -2) @ scaled)

    def _least(self, z: Complexes, q: Complexes, log_e: Reals) -> tuple[float, Any]:
        """Return the least g with z*z <= g^2 N, its vector; infinite where N is not positive."""
        try:
            values, vectors = scipy.linalg.eigh(z.conj().T @ z, self._scaled(q, log_e))
        except np.linalg.LinAlgError:
            return np.inf, np.zeros(z.shape[1], dtype=np.complex128)
        return float(np.sqrt(max(values[-1], 0.0))), vectors[:, -1]


def _triangle(M: Matrix) -> Matrix:
    """Return R with R'R = M'M and no more rows than M has columns that are not zero."""
    used = M.any(axis=0)
    if M.shape[0] <= used.sum():
        return M
    R = np.zeros((int(used.sum()), M.shape[1]))
    R[:, used] = np.linalg.qr(M[:, used], mode="r")
    return R


def _perron(M: Matrix) -> Reals:
    """Return the eigenvector of the spectral radius of a positive matrix."""
    values, vectors = np.linalg.eig(M)
    return np.asarray(np.abs(vectors[:, int(values.real.argmax())].real))


def _fed(left: Matrix, K: Matrix, phi: Any) -> Any:
    """Return left (K o phi), phi of one row where all rows of K act alike."""
    return (left @ K) * phi if phi.shape[-2] == 1 else left @ (K * phi)


def _excess(roots: Complexes, ratio: float, within: float) -> Reals:
    """Return by how much each root misses a damping ratio; negative where it does not count."""
    misses = ratio + roots.real / (np.abs(roots) + 1e-300)
    return np.asarray(np.minimum(misses, 1 + roots.real / within), dtype=np.float64)

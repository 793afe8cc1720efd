"""The LMI of Theorem 2, assembled once per system for any delays, k1 and k2.

The inequality is that of `cosim.hinf.theorems.theorem_2`, smaller and scaled for the solver:

* rows mj are taken out by their Schur complement: (x,mj), (xj,mj), (mj,mj) become
  dj [k1j; k2j] Rbar_j [k1j, k2j] on (x, xj), which is linear in Rbar_j as well; Rbar_j > 0
  follows from row rj;
* rows xj are multiplied by sqrt|k2j|, so that -2 X / k2j becomes -2 sign(k2j) X.

* Rbar_j is counted in multiples of max(1, dj), and rows rj are divided by the root of that;
* rows rj of all delays but one, b, are replaced by (rj - sqrt(dj/db) rb) / sqrt(1 + dj/db):
  their entries with x, xi and w cancel, only those with rb remain. The solver is fast on a
  sparse matrix.

The inequality stays equivalent. Omega is affine in the unknowns; each term is a fixed matrix
times a product of powers of k1, k2, d:

    Omega = sum_c factor_c(k1, k2, d) (T_c0 + sum_i y_i T_ci)

All T_c are built once; another k1, k2, d only changes the weights of their sum.
Unknowns y: upper triangles of X, of Qbar_j where it is free, of Rbar_j / max(1, dj) where
dj > 0; Y by rows; eps, one per block of F; gamma.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.svec import Array
from cosim.models import DelaySystem, Matrix

_ROOT2 = math.sqrt(2.0)


@dataclass(frozen=True)
class Scalars:
    """k1, k2 and the delays d: one number per delay; k2 not zero, d not negative."""

    k1: tuple[float, ...]
    k2: tuple[float, ...]
    d: tuple[float, ...]


_Factor = Callable[[Scalars], float]


def unit_of_R(d: float) -> float:
    """Return the unit in which Rbar_j is counted: it grows with a long delay."""
    return max(1.0, d)


@dataclass(frozen=True)
class Unknown:
    """A matrix of unknowns: its entry (i, j) is y[place[i, j]]."""

    place: NDArray[np.int64]

    def of(self, y: Array) -> Array:
        """Return the matrix at y."""
        return np.asarray(y[self.place], dtype=np.float64)


class Structure:
    """The LMI of one system for any `Scalars`; delays that are zero must stay zero.

    Attributes
    ----------
    size : number of unknowns.
    rows : rows of Omega.
    offset : first row of each block.
    base : index (from 1) of the delay b of the module's text.
    X, Y, eps, gamma : places of the unknowns; eps is one row with an entry per block of F; eps,
        gamma None where there are none.
    Q, R : one per delay; Q None for any age, R None for a delay of zero.
    spare : places of unknowns that do not occur here, for other constraints.
    """

    def __init__(self, system: DelaySystem, spare: int = 0) -> None:
        n, m = system.B.shape
        self.system = system
        self.late = tuple(delay.d > 0 for delay in system.delays)
        lengths = [delay.d for delay in system.delays]
        self.base = 1 + lengths.index(max(lengths)) if any(self.late) else None
        self.size = 0
        self.X = self._symmetric(n)
        self.Y = self._full(m, n)
        self.Q = tuple(None if x.any_age else self._symmetric(n) for x in system.delays)
        self.R = tuple(self._symmetric(n) if late else None for late in self.late)
        self.eps = self._full(1, len(system.blocks)) if system.blocks else None
        self.gamma = self._full(1, 1) if system.has_performance else None
        self.spare = self._full(1, spare).place[0]
        self.offset: dict[str, int] = {}
        self.rows = 0
        self._factors: list[_Factor] = []
        self._entries: list[tuple[NDArray[np.int64], NDArray[np.int64], Array, int]] = []
        self._lay_out()
        self._write()
        self._compile()

    def at(self, scalars: Scalars) -> Constraint:
        """Return -Omega >= 0 at these scalars."""
        weights = np.array([factor(scalars) for factor in self._factors])
        data = -(weights @ self._data)
        height = self.rows * (self.rows + 1) // 2
        ends = self._indptr
        columns = scipy.sparse.csc_array(
            (data[: ends[-2]], self._indices[: ends[-2]], ends[:-1]), shape=(height, self.size)
        )
        constant = np.zeros(height)
        constant[self._indices[ends[-2] :]] = data[ends[-2] :]
        return Constraint(self.rows, constant, columns)

    def with_gain(self, gain: Matrix) -> scipy.sparse.csc_array:
        """Return S with y = S y' for Y = K X; the entries of y' at Y have no effect."""
        keep = np.ones(self.size)
        keep[self.Y.place.ravel()] = 0.0
        rows, columns, values = [np.arange(self.size)], [np.arange(self.size)], [keep]
        n = gain.shape[1]
        for j in range(n):
            for k in range(n):  # Y[i, j] = sum_k K[i, k] X[k, j]
                rows.append(self.Y.place[:, j])
                columns.append(np.full(gain.shape[0], self.X.place[k, j]))
                values.append(gain[:, k])
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return scipy.sparse.csc_array(scipy.sparse.coo_array(entries, shape=(self.size, self.size)))

    def _symmetric(self, n: int) -> Unknown:
        place = np.zeros((n, n), dtype=np.int64)
        upper = np.triu_indices(n)
        place[upper] = self.size + np.arange(len(upper[0]))
        place.T[upper] = place[upper]
        self.size += len(upper[0])
        return Unknown(place)

    def _full(self, rows: int, columns: int) -> Unknown:
        place = self.size + np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
        self.size += rows * columns
        return Unknown(place)

    def _lay_out(self) -> None:
        system, n = self.system, self.system.A.shape[0]
        sizes = {f"x{i}": n for i in range(len(system.delays) + 1)}
        if system.has_performance:
            sizes |= {"w": system.C.shape[1], "z": system.D.shape[0]}
        sizes |= {f"r{j}": n for j, late in enumerate(self.late, 1) if late}
        if system.E.size:
            sizes["h"] = system.H.shape[0]
        for name, size in sizes.items():
            self.offset[name] = self.rows
            self.rows += size

    def _write(self) -> None:  # noqa: C901 - one table, read from top to bottom
        """Write the table of Theorem 2 entry by entry, with its symbols, in its order."""
        system, N = self.system, len(self.system.delays)
        n = system.A.shape[0]
        one, later = np.eye(n), range(1, N + 1)
        A = [system.A, *(delay.A for delay in system.delays)]
        H = [system.H, *(delay.H for delay in system.delays)]
        acts = [system.immediate_feedback, *(delay.feedback for delay in system.delays)]

        def a(i: int) -> _Factor:
            """Return the multiplier of row xi, |k2_i|^-1/2; 1 for x."""
            return (lambda _: 1.0) if i == 0 else (lambda p: abs(p.k2[i - 1]) ** -0.5)

        def root(j: int) -> _Factor:
            return lambda p: math.sqrt(p.d[j - 1] / unit_of_R(p.d[j - 1]))

        def G(row: str, column: str, i: int, factor: _Factor, *, flipped: bool = False) -> None:
            """Put factor times G_i = A_i X + phi_i B Y, or its transpose."""
            self._put(row, column, factor, A[i], self.X, one, flipped=flipped)
            if acts[i]:
                self._put(row, column, factor, system.B, self.Y, one, flipped=flipped)

        def EE(row: str, column: str, factor: _Factor) -> None:
            # columns of E one by one: the eps of a block is a 1 x 1 matrix
            for (columns, _), eps in zip(system.blocks, self._each_eps(), strict=True):
                for e in system.E.T[columns]:
                    self._put(row, column, factor, e[:, None], eps, e[None, :])

        G("x0", "x0", 0, lambda _: 2.0)
        EE("x0", "x0", lambda _: 1.0)
        for j in later:
            self._write_delay(j, one)
            G("x0", f"x{j}", j, a(j))
        base = self.base
        if base is not None:
            G("x0", f"r{base}", 0, root(base), flipped=True)
            EE("x0", f"r{base}", root(base))
            for i in later:
                G(f"x{i}", f"r{base}", i, _product(root(base), a(i)), flipped=True)
            EE(f"r{base}", f"r{base}", _product(root(base), root(base)))
            self._write_rates(base, {j: R for j, R in enumerate(self.R, 1) if R is not None})
        if self.gamma is not None:
            self._constant("x0", "w", lambda _: 1.0, system.C)
            self._constant("w", "z", lambda _: 1.0, system.D1.T)
            for name, size in (("w", system.C.shape[1]), ("z", system.D.shape[0])):
                for unit in np.eye(size):
                    self._put(name, name, lambda _: -1.0, unit[:, None], self.gamma, unit[None, :])
            self._put("x0", "z", lambda _: 1.0, system.D, self.X, one, flipped=True)
            for i in (i for i in range(N + 1) if acts[i]):
                self._put(f"x{i}", "z", a(i), system.D2, self.Y, one, flipped=True)
            if base is not None:
                self._constant("w", f"r{base}", root(base), system.C.T)
        if self.eps is not None:
            for i in range(N + 1):
                self._put(f"x{i}", "h", a(i), one, self.X, H[i].T)
            for (_, rows), eps in zip(system.blocks, self._each_eps(), strict=True):
                for unit in np.eye(H[0].shape[0])[rows]:
                    self._put("h", "h", lambda _: -1.0, unit[:, None], eps, unit[None, :])

    def _each_eps(self) -> list[Unknown]:
        """Return the eps of every block of F, as a 1 x 1 matrix."""
        return [] if self.eps is None else [Unknown(row[None, None]) for row in self.eps.place[0]]

    def _write_delay(self, j: int, one: Matrix) -> None:
        """Put the terms that Lemma 2 adds for delay j, except those with G."""
        Q, R, X = self.Q[j - 1], self.R[j - 1], self.X
        x = f"x{j}"

        def k1(p: Scalars) -> float:
            return p.k1[j - 1]

        def k2(p: Scalars) -> float:
            return p.k2[j - 1]

        def d(p: Scalars) -> float:
            return p.d[j - 1] * unit_of_R(p.d[j - 1])

        self._put("x0", "x0", lambda p: 2.0 * k1(p), one, X, one)
        self._put("x0", x, lambda p: (k2(p) - k1(p)) * abs(k2(p)) ** -0.5, one, X, one)
        self._put(x, x, lambda p: -2.0 * math.copysign(1.0, k2(p)), one, X, one)
        if Q is not None:
            self._put("x0", "x0", lambda _: 1.0, one, Q, one)
            self._put(x, x, lambda p: -1.0 / abs(k2(p)), one, Q, one)
        if R is not None:
            self._put("x0", "x0", lambda p: d(p) * k1(p) ** 2, one, R, one)
            self._put("x0", x, lambda p: d(p) * k1(p) * k2(p) * abs(k2(p)) ** -0.5, one, R, one)
            self._put(x, x, lambda p: d(p) * abs(k2(p)), one, R, one)

    def _write_rates(self, base: int, R: dict[int, Unknown]) -> None:
        """Put the blocks among the rows r, those of `base` subtracted from the others."""
        one = np.eye(self.system.A.shape[0])

        def share(j: int) -> _Factor:
            """Return the square root of dj / (db + dj), in the units of both rows."""

            def value(p: Scalars) -> float:
                own, longest = p.d[j - 1], p.d[base - 1]
                units = unit_of_R(longest) / unit_of_R(own)
                return math.sqrt(own / (longest + own) * units)

            return value

        def own(j: int) -> _Factor:
            return lambda p: -p.d[base - 1] / (p.d[base - 1] + p.d[j - 1])

        def both(j: int, k: int) -> _Factor:
            return lambda p: -share(j)(p) * share(k)(p)

        self._put(f"r{base}", f"r{base}", lambda _: -1.0, one, R[base], one)
        others = [j for j in R if j != base]
        for j in others:
            self._put(f"r{base}", f"r{j}", share(j), one, R[base], one)
            self._put(f"r{j}", f"r{j}", own(j), one, R[j], one)
            for k in (k for k in others if k >= j):
                self._put(f"r{j}", f"r{k}", both(j, k), one, R[base], one)

    def _put(
        self,
        row: str,
        column: str,
        factor: _Factor,
        L: Matrix,
        V: Unknown,
        R: Matrix,
        *,
        flipped: bool = False,
    ) -> None:
        """Add factor L V R (or its transpose) to a block; to a diagonal one its symmetric part."""
        # rows: entries of L V R, columns: entries of V, both by rows
        entries = np.asarray(np.kron(L, R.T), dtype=np.float64)
        target = self._positions(row, column, (L.shape[0], R.shape[1]), flipped=flipped)
        self._add(entries, target, V.place.ravel(), factor)

    def _constant(self, row: str, column: str, factor: _Factor, value: Matrix) -> None:
        target = self._positions(row, column, (value.shape[0], value.shape[1]), flipped=False)
        self._add(value.reshape(-1, 1), target, np.array([self.size]), factor)

    def _add(
        self,
        entries: Array,
        target: tuple[NDArray[np.int64], Array],
        columns: NDArray[np.int64],
        factor: _Factor,
    ) -> None:
        i, j = np.nonzero(entries)
        where, weight = target
        self._entries.append((where[i], columns[j], entries[i, j] * weight[i], len(self._factors)))
        self._factors.append(factor)

    def _positions(
        self, row: str, column: str, shape: tuple[int, int], *, flipped: bool
    ) -> tuple[NDArray[np.int64], Array]:
        """Return place in svec (upper triangle by columns) and weight of each entry of a block."""
        i, j = np.indices(shape)
        if flipped:
            i, j = j, i
        i, j = self.offset[row] + i.ravel(), self.offset[column] + j.ravel()
        low, high = np.minimum(i, j), np.maximum(i, j)
        share = _ROOT2 / 2 if row == column else _ROOT2
        weight = np.where(low == high, 1.0, share)
        return high * (high + 1) // 2 + low, weight

    def _compile(self) -> None:
        """Store all T_c with one sparsity pattern: columns side by side, one row per factor."""
        rows = np.concatenate([entry[0] for entry in self._entries])
        columns = np.concatenate([entry[1] for entry in self._entries])
        values = np.concatenate([entry[2] for entry in self._entries])
        owner = np.concatenate([np.full(len(entry[0]), entry[3]) for entry in self._entries])
        height = self.rows * (self.rows + 1) // 2
        keys, slot = np.unique(columns * height + rows, return_inverse=True)
        entries = (values, (owner, slot))
        shape = (len(self._factors), len(keys))
        self._data = scipy.sparse.csr_array(scipy.sparse.coo_array(entries, shape=shape))
        self._indices = keys % height
        self._indptr = np.searchsorted(keys // height, np.arange(self.size + 2))


def _product(one: _Factor, other: _Factor) -> _Factor:
    return lambda p: one(p) * other(p)

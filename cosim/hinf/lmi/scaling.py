"""Units in which a system's numbers are near one, powers of two: exact in both directions.

A solver loses its digits on a state in millimetres beside one in kilometres, or a rate of 1e6
1/s. With x = S x~, u = U u~, t = T t~, w = w~ a, z = z~ / a, and p = p~ c for the channel of
each block of the uncertainty,

    A~ = T S^-1 A S,  B~ = T S^-1 B U,  C~ = a T S^-1 C,  E~ = c T S^-1 E,  H~ = H S / c,
    D~ = a D S,  D1~ = a^2 D1,  D2~ = a D2 U,  d~ = d/T,  k1~ = T k1,  k2~ = T k2,

and a solution of the LMI of Theorem 2 is converted by a congruence of its rows (`problem`):

    X = S X~ S / T,  Q = S Q~ S / T^2,  R = S R~ S / T,  Y = U Y~ S / T,  eps = c^2 eps~,
    gamma = gamma~ / a^2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.lmi.svec import Array
from cosim.models import Delay, DelaySystem

_EXPONENT = 200  # powers of two stay within this: their products must not overflow
_LARGEST = 1e30
_SPREAD = 100.0
_EVEN = 1e3
"""Largest ratio of balanced units, and of a system's entries, that are taken to be near one."""


@dataclass(frozen=True, eq=False)
class Scaling:
    """The units: `state` (n,), `input` (m,), and T, a, c of the module's text.

    c has one entry per block of F; one where nothing is uncertain.
    """

    state: Array
    input: Array
    T: float
    a: float
    c: Array

    def system(self, system: DelaySystem) -> DelaySystem:
        """Return the system in these units."""
        S, U, T, a = self.state, self.input, self.T, self.a
        rows = T / S[:, None]
        c_E, c_H = self.per_block(system, self.c)
        return replace(
            system,
            A=rows * system.A * S,
            B=rows * system.B * U,
            C=a * rows * system.C,
            D=a * system.D * S,
            D1=a**2 * system.D1,
            D2=a * system.D2 * U,
            E=c_E * rows * system.E,
            H=system.H * S / c_H[:, None],
            delays=tuple(
                # what else is known of an age is not used here: it is one of any age
                Delay(x.d / T, rows * x.A * S, x.H * S / c_H[:, None], x.feedback, x.any_age)
                for x in system.delays
            ),
        )

    @staticmethod
    def per_block(system: DelaySystem, values: Array) -> tuple[Array, Array]:
        """Return a number per block of F at each column of E (s,) and each row of H (r,)."""
        columns, rows = np.ones(system.E.shape[1]), np.ones(len(system.H))
        for (p, q), value in zip(system.blocks, values, strict=False):
            columns[p], rows[q] = value, value
        return columns, rows

    def gain(self, K: Array) -> Array:
        """Return K~ of K."""
        return np.asarray(K / self.input[:, None] * self.state)


def scaling_of(system: DelaySystem) -> Scaling:
    """Choose units for a system by balancing the matrix of influences.

    Its rows: each state, each input, the channel of each block of the uncertainty, that of w and
    z. Each entry of B has its inverse from the state back to the input, at the system's own rate.

    Raises
    ------
    InputError : a number too far from one for any unit.
    """
    _check(system)
    n, m = system.B.shape
    flow = _total(system.A, *(x.A for x in system.delays))
    H = _total(system.H, *(x.H for x in system.delays))
    # the spectral radius of absolute values does not depend on units
    rate = float(np.abs(np.linalg.eigvals(flow)).max())
    longest = max((x.d for x in system.delays), default=0.0)
    if rate <= 1e-9 * float(flow.max()):  # a chain of integrators has none of its own
        rate = 1.0 / longest if longest > 0 else 1.0
    B = np.abs(system.B)
    back = np.divide(rate, B, out=np.zeros((n, m)), where=B > 0).T
    gain = _rough_gain(system, flow, rate, back)
    a = float(_power(np.array(gain**-0.5)))
    channels = max(1, len(system.blocks))
    x, u, z = slice(0, n), slice(n, n + m), n + m + channels
    acts = np.zeros((z + 1, z + 1))
    acts[x, x], acts[x, u], acts[u, x] = flow / rate, B / rate, back
    for p, (columns, rows) in enumerate(system.blocks, n + m):
        acts[x, p], acts[p, x] = _largest(system.E[:, columns], 1) / rate, _largest(H[rows], 0)
    acts[x, z], acts[z, x] = a * _largest(system.C, 1) / rate, a * _largest(system.D, 0)
    acts[z, u] = a * _largest(system.D2, 0)
    _, (units, _) = scipy.linalg.matrix_balance(acts, permute=False, separate=True)
    units = _power(np.asarray(units, dtype=np.float64) / units[z])
    return Scaling(units[x], units[u], float(_power(np.array(1.0 / rate))), a, units[n + m : z])


def units_of(system: DelaySystem) -> list[Scaling]:
    """Return the units to solve in: those of `scaling_of`, and the system's own, best first.

    Balancing spreads the units of a long chain of states over decades, and gamma with them,
    though every number of the system is near one. There the system's own units come first. All
    have the same time.

    Raises
    ------
    InputError : as `scaling_of`.
    """
    balanced = scaling_of(system)
    n, m = system.B.shape
    in_units = replace(
        balanced, state=np.ones(n), input=np.ones(m), a=1.0, c=np.ones_like(balanced.c)
    )
    spread = float(balanced.state.max() / balanced.state.min())
    s = system
    parts = (s.A, s.B, s.C, s.D, s.D2, s.E, s.H, *(M for x in s.delays for M in (x.A, x.H)))
    entries = np.concatenate([np.abs(M[M != 0]).ravel() for M in parts])
    even = entries.size and entries.max() < _EVEN * entries.min()
    return [in_units, balanced] if even and spread > _SPREAD else [balanced, in_units]


def _rough_gain(system: DelaySystem, flow: Array, rate: float, back: Array) -> float:
    """Estimate gamma independently of units: all paths from w to z in absolute values."""
    out = np.abs(system.D)
    if not out.any():
        out = np.abs(system.D2) @ back
    resolvent = np.linalg.inv(2.0 * rate * np.eye(len(flow)) - flow)
    paths = np.abs(out @ resolvent @ np.abs(system.C))
    gain = max(float(paths.max(initial=0.0)), float(_largest(system.D1, 1).max(initial=0.0)))
    return gain if gain > 0 else 1.0


def _check(system: DelaySystem) -> None:
    named = {name: getattr(system, name) for name in ("A", "B", "C", "D", "D1", "D2", "E", "H")}
    for j, delay in enumerate(system.delays):
        named |= {f"delays[{j}].{name}": getattr(delay, name) for name in ("A", "H")}
        named[f"delays[{j}].d"] = np.array([[delay.d]])
    for name, matrix in named.items():
        check_size(name, matrix)


def check_size(name: str, values: ArrayLike) -> None:
    """Refuse a number that is not zero and too far from one to compute with.

    Raises
    ------
    InputError : naming it.
    """
    size = np.abs(np.asarray(values, dtype=np.float64))
    odd = size[(size > 0) & ~((size > 1.0 / _LARGEST) & (size < _LARGEST))]
    if odd.size:
        raise InputError(
            "a number is too far from one",
            where=name,
            expected=f"zero, or between {1 / _LARGEST:g} and {_LARGEST:g}",
            got=f"{odd[0]:g}",
            hint="other units for it",
        )


def _total(*matrices: Array) -> Array:
    return np.asarray(sum(np.abs(M) for M in matrices))


def _largest(matrix: Array, axis: int) -> Array:
    return np.asarray(np.abs(matrix).max(axis=axis, initial=0.0))


def _power(values: Array) -> Array:
    """Return the nearest powers of two."""
    return np.asarray(np.exp2(np.clip(np.round(np.log2(values)), -_EXPONENT, _EXPONENT)))

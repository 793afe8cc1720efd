"""Weights that depend on frequency: filters as state-space before w and behind z.

    w = W_w v:  x_w' = A_w x_w + B_w v,  w = C_w x_w + D_w v
    z -> W_z z: x_z' = A_z x_z + B_z z,  C_z x_z + D_z z

The filters' states are further states of the system, which nobody measures: K has zeros there, and
the certificate is about the gain from v to the weighted z. Where the control acts late, so it does
in z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.models import Delay, DelaySystem, Matrix


@dataclass(frozen=True, eq=False)
class Filter:
    """A stable linear filter x' = A x + B v, y = C x + D v.

    A (k, k), B (k, q), C (p, k), D (p, q).
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    @classmethod
    def from_matrices(
        cls, A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike | None = None, *, where: str
    ) -> Filter:
        """Return the filter of four matrices; D zero where it is absent.

        Raises
        ------
        InputError : matrices that do not fit, or a filter that is not stable.
        """
        given = [np.atleast_2d(np.asarray(M, dtype=np.float64)) for M in (A, B, C)]
        k = given[0].shape[0]
        last = (given[2].shape[0], given[1].shape[1])
        direct = np.zeros(last) if D is None else np.atleast_2d(np.asarray(D, dtype=np.float64))
        if (
            given[0].shape != (k, k)
            or given[1].shape[0] != k
            or given[2].shape[1] != k
            or direct.shape != last
            or not all(np.isfinite(M).all() for M in (*given, direct))
        ):
            raise InputError(
                "not a filter",
                where=where,
                expected="A (k, k), B (k, q), C (p, k) and D (p, q) of finite numbers",
                got=", ".join(f"{n} {M.shape}" for n, M in zip("ABC", given, strict=True)),
            )
        filter_ = cls(given[0], given[1], given[2], direct)
        if k and np.linalg.eigvals(filter_.A).real.max() >= 0:
            raise InputError(
                "this filter is not stable: no gain moves its poles",
                where=where,
                expected="poles with a negative real part",
                got=f"{np.linalg.eigvals(filter_.A).real.max():g}",
                hint="move a pole at zero slightly to the left",
            )
        return filter_

    @classmethod
    def from_coefficients(
        cls, rows: Sequence[tuple[Sequence[float], Sequence[float]]], *, where: str
    ) -> Filter:
        """Return a diagonal filter, from numerators and denominators by falling powers of s.

        Raises
        ------
        InputError : a quotient that is not proper, or a filter that is not stable.
        """
        parts: list[tuple[Any, ...]] = []
        for i, (top, bottom) in enumerate(rows):
            numerator, denominator = np.trim_zeros(top, "f"), np.trim_zeros(bottom, "f")
            if not denominator or len(numerator) > len(denominator):
                raise InputError(
                    "not a proper transfer function",
                    where=f"{where}[{i}]",
                    expected="a denominator of at least the numerator's degree, not zero",
                    got=f"{list(top)} over {list(bottom)}",
                )
            if len(denominator) == 1:
                gain = (numerator[0] if numerator else 0.0) / denominator[0]
                parts.append((np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[gain]]))
            else:
                parts.append(scipy.signal.tf2ss(numerator or [0.0], denominator))
        matrices = [
            scipy.linalg.block_diag(*(np.asarray(M) for M in column))
            for column in zip(*parts, strict=True)
        ]
        return cls.from_matrices(*matrices, where=where)


def filtered(
    system: DelaySystem, *, z: Filter | None = None, w: Filter | None = None
) -> DelaySystem:
    """Return the system with a filter behind z, one before w, or both.

    Parameters
    ----------
    system : Eq. (7) (n states, p outputs z, q disturbances w).
    z : with p inputs.
    w : with q outputs.

    Raises
    ------
    InputError : sizes that do not fit, or a system without w and z.
    """
    if not system.has_performance:
        raise InputError("filters need w and z", where="weights", expected="a system with C and D")
    if system.integrals:
        raise InputError(
            "filters come before integral action", where="weights", hint="integrate after them"
        )
    if w is not None:
        _check(w.C.shape[0], system.C.shape[1], "weights.w", "outputs, one per w")
        k = len(w.A)
        system = _augmented(
            system,
            k,
            A=np.block([[system.A, system.C @ w.C], [np.zeros((k, len(system.A))), w.A]]),
            B=np.vstack([system.B, np.zeros((k, system.B.shape[1]))]),
            C=np.vstack([system.C @ w.D, w.B]),
            D=np.hstack([system.D, system.D1 @ w.C]),
            D1=system.D1 @ w.D,
        )
    if z is not None:
        _check(z.B.shape[1], system.D.shape[0], "weights.z", "inputs, one per row of z")
        k = len(z.A)
        system = _augmented(
            system,
            k,
            A=np.block([[system.A, np.zeros((len(system.A), k))], [z.B @ system.D, z.A]]),
            B=np.vstack([system.B, z.B @ system.D2]),
            C=np.vstack([system.C, z.B @ system.D1]),
            D=np.hstack([z.D @ system.D, z.C]),
            D1=z.D @ system.D1,
            D2=z.D @ system.D2,
        )
    return system


def _check(have: int, want: int, where: str, what: str) -> None:
    if have != want:
        raise InputError(
            "this filter does not fit the system",
            where=where,
            expected=f"{want} {what}",
            got=str(have),
        )


def _augmented(system: DelaySystem, k: int, **matrices: Any) -> DelaySystem:
    """Return the system with these matrices and k further states that nobody measures."""
    more = np.zeros((len(system.H), k))
    at_once, *delayed = system.selections
    delays = tuple(
        Delay(
            x.d,
            scipy.linalg.block_diag(x.A, np.zeros((k, k))),
            np.hstack([x.H, more]),
            _with_unmeasured(selection, k),
            x.any_age,
            least_age=x.least_age,
            rate=x.rate,
            sampled=x.sampled,
        )
        for x, selection in zip(system.delays, delayed, strict=True)
    )
    return replace(
        system,
        **matrices,
        E=np.vstack([system.E, np.zeros((k, system.E.shape[1]))]),
        H=np.hstack([system.H, more]),
        delays=delays,
        feedback=_with_unmeasured(at_once, k) if at_once.any() else None,
    )


def _with_unmeasured(selection: Matrix, k: int) -> Any:
    """Return a selection, or a mask of entries of K, with k further states that are not in it."""
    return tuple((np.hstack([selection, np.zeros((*selection.shape[:-1], k))]) > 0).tolist())

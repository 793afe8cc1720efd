"""The nominal closed loop of Eq. (7) with u = K x.

    x'(t) = sum_i A_i x(t-d_i) + C w(t)
    z(t)  = sum_i D_i x(t-d_i) + D1 w(t)

No uncertainty: F = 0 in the dA = E F H of Eq. (7). D has one matrix per delay, since feedback
over a link makes D2 K act on the delayed state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.models import DelaySystem

Matrix = NDArray[np.float64]
Stack = NDArray[np.complex128]


def checked_matrix(name: str, value: ArrayLike, rows: int | None, columns: int | None) -> Matrix:
    """Return a read-only float copy of `value`, checked against the shape (None: any)."""
    shape = f"({'any' if rows is None else rows}, {'any' if columns is None else columns})"
    expected = f"a matrix of finite numbers, shape {shape}"
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            "not a matrix", where=name, expected=expected, got=type(value).__name__
        ) from error
    wrong = matrix.ndim != 2 or any(
        want is not None and have != want
        for have, want in zip(matrix.shape, (rows, columns), strict=False)
    )
    if wrong:
        raise InputError("wrong shape", where=name, expected=expected, got=str(matrix.shape))
    if not np.isfinite(matrix).all():
        raise InputError("not finite", where=name, expected=expected, got="nan or infinity")
    matrix.setflags(write=False)
    return matrix


def checked_loop(loop: Any) -> None:
    """Raise an `InputError` for what is no closed loop."""
    if not isinstance(loop, ClosedLoop):
        raise InputError(
            "not a closed loop",
            where="loop",
            expected="a ClosedLoop, as of close(system, K), or a DelayLTI",
            got=type(loop).__name__,
            hint="of a design: design.loop",
        )


@dataclass(frozen=True, init=False, eq=False, repr=False)
class ClosedLoop:
    """x' = sum_i A_i x(t-d_i) + C w, z = sum_i D_i x(t-d_i) + D1 w.

    Delays are sorted, equal ones are merged (their matrices added), and the first is always
    d_0 = 0. Without C or without D only stability can be analysed: C and D1 are None, D is empty.

    Parameters
    ----------
    A : (n, n) per delay.
    delays : the delays [s], finite and not negative, one per matrix of A.
    C : (n, q) disturbance matrix; None: no disturbance.
    D : (p, n) per delay; empty: no performance output.
    D1 : (p, q) direct term; None: zero.

    Raises
    ------
    InputError : naming the matrix, what was expected and what was got.
    """

    A: tuple[Matrix, ...]
    delays: tuple[float, ...]
    C: Matrix | None
    D: tuple[Matrix, ...]
    D1: Matrix | None

    def __init__(
        self,
        A: Sequence[ArrayLike],
        delays: Sequence[float],
        C: ArrayLike | None = None,
        D: Sequence[ArrayLike] = (),
        D1: ArrayLike | None = None,
    ) -> None:
        if not A or len(A) != len(delays):
            raise InputError(
                "A and delays do not match",
                where="closed loop",
                expected="one matrix A per delay, at least one",
                got=f"{len(A)} matrices, {len(delays)} delays",
            )
        for i, d in enumerate(delays):
            if not (math.isfinite(d) and d >= 0):
                raise InputError(
                    "not a delay", where=f"delays[{i}]", expected="seconds >= 0", got=str(d)
                )
        n = checked_matrix("A[0]", A[0], None, None).shape[0]
        if n == 0:
            raise InputError("no state", where="A[0]", expected="n >= 1", got="shape (0, 0)")
        merged = tuple(sorted({0.0, *(float(d) for d in delays)}))

        def merge(name: str, matrices: Sequence[ArrayLike], rows: int) -> tuple[Matrix, ...]:
            sums = {d: np.zeros((rows, n)) for d in merged}
            for i, (d, value) in enumerate(zip(delays, matrices, strict=True)):
                sums[float(d)] = sums[float(d)] + checked_matrix(f"{name}[{i}]", value, rows, n)
            return tuple(checked_matrix(name, total, rows, n) for total in sums.values())

        performance = C is not None and len(D) > 0
        if not performance and D1 is not None:
            raise InputError(
                "D1 without w and z", where="D1", expected="C and D as well", got="not both"
            )
        object.__setattr__(self, "A", merge("A", A, n))
        object.__setattr__(self, "delays", merged)
        object.__setattr__(self, "C", None)
        object.__setattr__(self, "D", ())
        object.__setattr__(self, "D1", None)
        if performance:
            if len(D) != len(delays):
                raise InputError(
                    "D and delays do not match",
                    where="closed loop",
                    expected=f"one matrix D per delay, {len(delays)}",
                    got=str(len(D)),
                )
            disturbance = checked_matrix("C", np.asarray(C), n, None)
            p = checked_matrix("D[0]", D[0], None, n).shape[0]
            direct = np.zeros((p, disturbance.shape[1])) if D1 is None else D1
            object.__setattr__(self, "C", disturbance)
            object.__setattr__(self, "D", merge("D", D, p))
            object.__setattr__(self, "D1", checked_matrix("D1", direct, p, disturbance.shape[1]))

    def __repr__(self) -> str:
        listed = ", ".join(f"{d:.6g}" for d in self.delays[1:])
        gain = "no w or no z" if self.D1 is None else "{1} w, {0} z".format(*self.D1.shape)
        delays = f"delays {listed} s" if listed else "no delay"
        return f"<ClosedLoop: {self.order} states, {gain}, {delays}>"

    @property
    def order(self) -> int:
        """Number n of states."""
        return int(self.A[0].shape[0])

    @property
    def has_performance(self) -> bool:
        """Whether there are w and z, and so a gain from one to the other."""
        return self.C is not None

    @property
    def direct(self) -> Matrix:
        """D1 (p, q).

        Raises
        ------
        InputError : the loop has no w or no z.
        """
        if self.D1 is None:
            raise InputError(
                "this loop has no gain from w to z",
                where="closed loop",
                expected="a disturbance w (C) and a performance output z (D)",
                got="a loop without one of them: only its stability can be analysed",
            )
        return self.D1

    @cached_property
    def sizes(self) -> Matrix:
        """|A_i|, the 2-norm of every A_i."""
        return np.array([np.linalg.norm(A, 2) for A in self.A])

    def bound(self, real: float) -> float:
        """Return a bound of |s| for roots with Re s >= real: sum_i |A_i| e^{-real d_i}."""
        return float(self.sizes @ np.exp(-real * np.array(self.delays)))

    def state_matrix(self, s: Any) -> Stack:
        """Return sum_i A_i e^{-s d_i}; s.shape + (n, n)."""
        return _sum(self.A, self._late(s))

    def characteristic_matrix(self, s: Any) -> tuple[Stack, Stack]:
        """Return H(s) = s I - sum_i A_i e^{-s d_i} and dH/ds, each s.shape + (n, n)."""
        eye, phases = np.eye(self.order), self._late(s)
        H = np.asarray(s)[..., None, None] * eye - _sum(self.A, phases)
        return H, eye + _sum(self.A, phases * np.array(self.delays))

    def resolvent(self, s: Any) -> tuple[Stack, Stack, Stack]:
        """Return S = H^-1, S C and D S at s; only where there are w and z."""
        phases = self._late(s)
        S = np.linalg.inv(s[..., None, None] * np.eye(self.order) - _sum(self.A, phases))
        return S, S @ np.asarray(self.C), _sum(self.D, phases) @ S

    def output_matrix(self, s: Any) -> Stack:
        """Return sum_i D_i e^{-s d_i}; s.shape + (p, n). Only where there are w and z."""
        return _sum(self.D, self._late(s))

    def transfer(self, omega: ArrayLike) -> Stack:
        """Return G(s) = D(s) (s I - A(s))^-1 C + D1 at s = j omega; omega.shape + (p, q).

        Raises
        ------
        InputError : the loop has no w or no z.
        numpy.linalg.LinAlgError : j omega is a root of the loop.
        """
        D1, s = self.direct, 1j * np.asarray(omega, dtype=np.float64)
        H = s[..., None, None] * np.eye(self.order) - self.state_matrix(s)
        C = np.asarray(self.C, dtype=np.complex128)
        inner = np.linalg.solve(H, np.broadcast_to(C, (*s.shape, *C.shape)))
        return np.asarray(self.output_matrix(s) @ inner + D1, dtype=np.complex128)

    def _late(self, s: Any) -> Stack:
        """Return the factors e^{-s d_i}, s.shape + (N + 1,)."""
        phases: Stack = np.exp(
            -np.asarray(s, dtype=np.complex128)[..., None] * np.array(self.delays)
        )
        return phases


def _sum(matrices: tuple[Matrix, ...], weights: Stack) -> Stack:
    total: Stack = np.einsum("...i,ijk->...jk", weights, matrices)
    return total


def balanced(A: Sequence[Matrix]) -> list[Matrix]:
    """Return T^-1 A_i T for one diagonal T of powers of two: the same roots, without rounding.

    States in very different units make norms large, and the bounds made of them coarse.
    """
    sizes = np.abs(np.array(A)).sum(axis=0)
    scale = np.diag(scipy.linalg.matrix_balance(sizes, permute=False)[1])
    return [M * scale[None, :] / scale[:, None] for M in A]


def close(system: DelaySystem, K: ArrayLike) -> ClosedLoop:
    """Close the loop with u = K sum_i S_i x(t-d_i), S_i = I where all feedback acts; F = 0.

        >>> from cosim import DelaySystem, link
        >>> from cosim.hinf.delay_lti import close
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]], delays=[link(0.5)])
        >>> loop = close(system, [[-1.0]])
        >>> loop.delays, [float(A[0, 0]) for A in loop.A]
        ((0.0, 0.5), [0.1, -1.0])

    A_i + B K S_i acts on x(t-d_i), D (on i = 0) + D2 K S_i makes z.

    Parameters
    ----------
    system : Eq. (7) with several delays; its E, H are ignored.
    K : (m, n) state feedback.

    Raises
    ------
    InputError : K has the wrong shape or is not finite.
    """
    A, D, delays = closed_terms(system, K)
    if not system.has_performance:
        return ClosedLoop(A, delays)
    return ClosedLoop(A, delays, system.C, D, system.D1)


class Terms(NamedTuple):
    """The matrices of the loop, one per delay; equal delays are not merged."""

    A: list[Matrix]
    D: list[Matrix]
    delays: list[float]


def closed_terms(system: DelaySystem, K: ArrayLike) -> Terms:
    """Return A_i + B K S_i, D (on i = 0) + D2 K S_i and d_i, d_0 = 0 first.

    A sampled age stands there with its mean (`Delay.constant_age`).

    Raises
    ------
    InputError : as `close`.
    """
    n, m = system.B.shape
    gain = checked_matrix("K", K, m, n)
    chosen = system.selections
    open_A = (system.A, *(delay.A for delay in system.delays))
    open_D = (system.D, *(np.zeros_like(system.D) for _ in system.delays))
    fed = [gain * S if S.any() else None for S in chosen]
    A = [M if K_i is None else M + system.B @ K_i for M, K_i in zip(open_A, fed, strict=True)]
    D = [M if K_i is None else M + system.D2 @ K_i for M, K_i in zip(open_D, fed, strict=True)]
    return Terms(A, D, [0.0, *(delay.constant_age for delay in system.delays)])


def checked_system(system: Any, *, control: bool = False) -> DelaySystem:
    """Return `system` if it is a `DelaySystem`, with `control` only if it has a B.

    Raises
    ------
    InputError : it is something else (the message says how to convert it), or has no B.
    """
    if isinstance(system, DelaySystem):
        n, m = system.B.shape
        if control and not m:
            raise InputError(
                "there is no gain to design: the system has no control, B is missing",
                where=f"{system.name}: B" if system.name else "B",
                expected=f"B, {n} rows with one column per control",
                got="no B",
                hint="give B beside A, or analyse the system as it is (cosim analyse)",
            )
        return system
    is_plant = all(hasattr(system, name) for name in "ABCD")
    raise InputError(
        "not a system with delays",
        where="system",
        expected="a DelaySystem",
        got=type(system).__name__,
        hint="DelaySystem.from_state_space(plant, ncon=..., delays=[...])" if is_plant else None,
    )

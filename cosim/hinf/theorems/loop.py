"""The closed loop of an analysis, exactly: x' = f = sum_i A_i x(t - tau_i) + C w + E p, u = K x.

Doubles are taken exactly, A_i + B K S_i exact; delays of zero are no delays and belong to x(t).
A positive delay may act through its *support* alone, y = C_j x: some of the states, or, where it
acts through the control only, rows of K S_j. Then A_j y, H_j y and D_j y stand for its terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import flint
import numpy as np

from cosim.hinf.exact import exact, exact_matrix, identity
from cosim.hinf.theorems.inequality import Inequality, Signal

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix


@dataclass(frozen=True)
class Support:
    """What of x is needed late, y(t - age) with y = C x: the support of one delay.

    Attributes
    ----------
    of : "states": C selects states, the others have no entry in A_i + B K S_i, H_i and D2 K S_i.
        "controls": C is rows of K S_i, where A_i = 0 and H_i = 0, and the delay acts through u.
    numbers : of the states or controls, from 0, ascending.
    """

    of: Literal["states", "controls"]
    numbers: tuple[int, ...]


Supports = Sequence[Support | None]
"""The support of every positive delay; None: the whole state."""


@dataclass(frozen=True)
class Loop:
    """The loop in `fmpq_mat`: A, H, D of x(t), then of every positive delay; C_j of these.

    Attributes
    ----------
    delays : the positive ones, and `d` [s] as `fmpq`.
    """

    A: list[Any]
    H: list[Any]
    D: list[Any]
    support: list[Any]
    C: Any
    D1: Any
    E: Any
    blocks: tuple[tuple[slice, slice], ...]
    delays: list[Delay]
    d: list[Any]

    @classmethod
    def of(cls, system: DelaySystem, gain: Matrix, supports: Supports | None = None) -> Loop:
        """Close the loop u = K sum_i S_i x(t - d_i); `supports` : one per positive delay."""
        B, D2, n = exact_matrix(system.B), exact_matrix(system.D2), len(system.A)
        at_once, *delayed = [gain * selection for selection in system.selections]
        A = [exact_matrix(system.A) + B * exact_matrix(at_once)]
        H, D = [exact_matrix(system.H)], [exact_matrix(system.D) + D2 * exact_matrix(at_once)]
        C: list[Any] = []
        each = iter(supports or [None] * len(delayed))
        for delay, acting in zip(system.delays, delayed, strict=True):
            K = exact_matrix(acting)
            of_delay = [exact_matrix(delay.A) + B * K, exact_matrix(delay.H), D2 * K]
            if not delay.d > 0:
                A[0], H[0], D[0] = (
                    M[0] + more for M, more in zip((A, H, D), of_delay, strict=True)
                )
                continue
            support, select = next(each), identity(n)
            if support is not None and support.of == "controls":
                rows = list(support.numbers)
                select = exact_matrix(acting[rows])
                none = flint.fmpq_mat(len(system.H), len(rows))
                of_delay = [exact_matrix(system.B[:, rows]), none, exact_matrix(system.D2[:, rows])]
            elif support is not None:
                select = exact_matrix(np.eye(n)[list(support.numbers)])
                of_delay = [M * select.transpose() for M in of_delay]
            C.append(select)
            for matrices, more in zip((A, H, D), of_delay, strict=True):
                matrices.append(more)
        rest = exact_matrix(system.C), exact_matrix(system.D1), exact_matrix(system.E)
        positive = positive_delays(system)
        return cls(A, H, D, C, *rest, system.blocks, positive, [exact(x.d) for x in positive])

    def rows(self, *, bounded: bool) -> dict[str, int]:
        """Return the rows of w, of p where something is uncertain; `bounded` : of a gain."""
        rows = {"w": self.C.ncols()} if bounded else {}
        return rows | ({"p": self.E.ncols()} if self.blocks else {})

    def rate(self, form: Inequality, on: Sequence[Signal]) -> Signal:
        """Return f; `on` : x(t), then what the positive delays act on."""
        f = _sum(self.A, on)
        f = f + self.C * form.row("w") if "w" in form.rows else f
        return f + self.E * form.row("p") if self.blocks else f

    def subtract_gain_and_uncertainty(
        self, form: Inequality, on: Sequence[Signal], *, bounded: bool, eps: str = "eps"
    ) -> None:
        """Subtract z'z/gamma - gamma w'w, where `bounded`, and eps (q'q - p'p), p = F q.

        F = diag(F_1, ..), F_b'F_b <= I is |p_b|^2 <= |q_b|^2: one number eps[b] >= 0 for each.
        """
        q = _sum(self.H, on)
        for b, (columns, of_H) in enumerate(self.blocks):
            form.number(f"{eps}[{b}]", q.rows(of_H), -1)
            form.number(f"{eps}[{b}]", form.row("p").rows(columns))
        if bounded:
            form.number("1/gamma", _sum(self.D, on) + self.D1 * form.row("w"), -1)
            form.number("gamma", form.row("w"))


def positive_delays(system: DelaySystem) -> list[Delay]:
    """Return the positive delays; one of zero is none, its term belongs to x(t)."""
    return [delay for delay in system.delays if delay.d > 0]


def _sum(matrices: Sequence[Any], on: Sequence[Signal]) -> Signal:
    parts: list[Signal] = [M * signal for M, signal in zip(matrices, on, strict=True)]
    return sum(parts[1:], parts[0])

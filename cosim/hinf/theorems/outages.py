"""What is proved of a loop whose link drops out: one functional for both modes.

In touch, u = K x(t - tau), every tau(t) at most d however it varies. Out of touch, by age d, the
receiver falls back: u = K_o x(t - o), o(t) at most `fallback_age`; K_o = 0 is zero input. A value
that is held beyond age d belongs to neither mode: x(s_k) is not in the functional.

With the positive delays d_j, r_j rational, 0 < r_j <= e^{-2 alpha d_j}, |v|_R^2 = v'R v, and k(s)
= e^{2 alpha (s - t)}, the same kernels in both modes,

    V = x'P x + sum_j (int_{t-d_j}^t k x'S_j x + d_j int_{-d_j}^0 int_{t+h}^t k x''R_j x' ds dh).

Along x' = f, by Jensen's inequality, and for a delay that varies by the reciprocally convex
combination (Park, Ko, Jeong, Automatica 47 (2011) 235), V' + 2 alpha V is at most

    He(x'P f) + 2 alpha |x|_P^2 + sum_j (|x|_Sj^2 - r_j |x_dj|_Sj^2 + d_j^2 |f|_Rj^2 - r_j J_j),
    J_j = |x - x_dj|_Rj^2 of a constant delay,
    J_j = [x - x_j; x_j - x_dj]'[R_j M_j; M_j' R_j][..] of one that varies, x_j = x(t - tau_j).

Out of touch, with f_o, the terms of the integrals are the same, since 2 beta >= -2 alpha:
V' - 2 beta V is at most this with -2 beta in place of 2 alpha, and, for the delay of the feedback,

    J = |x - x_d|_R^2 where the fallback acts at once, or is zero; otherwise
    J = (d / fallback_age) |x - x_o|_R^2 + |x_o - x_d|_R^2,  x_o = x(t - o).

With eps (q'q - p'p) + z'z/gamma - gamma w'w added, both forms are shown to be negative definite;
eps may differ from mode to mode, gamma may not. Nothing is added when touch is regained: V is taken
on the real past. A delay below d_j, constant or not, is covered: each term only grows with d_j.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.theorems.inequality import Inequality, itself
from cosim.hinf.theorems.loop import Loop, positive_delays

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix


@dataclass(frozen=True, eq=False)
class Modes:
    """The two modes, and how fast V falls and grows in them; exact numbers (`fmpq`).

    alpha, beta : V falls at least as e^{-2 alpha t} in touch, and grows at most as e^{2 beta t}
        out of touch [1/s]; beta may be negative.
    gamma : bound of the weighted gain from w to z; None for stability alone.
    rho : r_j per positive delay, at most e^{-2 alpha d_j}.
    fallback : (m, n) K_o of the fallback, doubles; zero for zero input.
    fallback_age : its greatest age [s], a double; 0: it acts at once.
    """

    alpha: Any
    beta: Any
    gamma: Any
    rho: tuple[Any, ...]
    fallback: Matrix
    fallback_age: float


def varies(delay: Delay) -> bool:
    """Whether a delay is one of any age here: the plant's, if it is so given, or the feedback's."""
    return delay.any_age or bool(delay.feedback)


def outage_inequalities(system: DelaySystem, gain: Matrix, modes: Modes) -> Iterator[Inequality]:
    """Yield what must be positive in P, S[j], R[j], M[j], eps[b], eps_out[b] and gamma."""
    yield from positive_of_outages(system)
    for lost in (False, True):
        yield minus_phi_of_outages(system, gain, modes, lost=lost)


def positive_of_outages(system: DelaySystem) -> Iterator[Inequality]:
    """Yield what must be positive beside -Phi."""
    n, positive = len(system.A), positive_delays(system)
    several = (f"{name}[{j}]" for name in "SR" for j in range(len(positive)))
    for name in ("P", *several):
        yield itself(name, n)
    for j, delay in enumerate(positive):
        if varies(delay):
            form = Inequality(f"[R M[{j}]; M' R]", {"v": n, "u": n})
            form.square(f"R[{j}]", form.row("v"))
            form.square(f"R[{j}]", form.row("u"))
            form.twice(f"M[{j}]", form.row("v"), form.row("u"))
            yield form


def _out_of_touch(system: DelaySystem, gain: Matrix, modes: Modes) -> Loop:
    """Return the loop with the fallback, in place of the feedback's delay where it is late."""
    out, K = Loop.of(system, np.zeros_like(gain)), exact_matrix(modes.fallback)
    j = 0
    if modes.fallback_age > 0:
        j = 1 + next(i for i, delay in enumerate(out.delays) if delay.feedback)
    A, D = list(out.A), list(out.D)
    A[j] += exact_matrix(system.B) * K
    D[j] += exact_matrix(system.D2) * K
    return replace(out, A=A, D=D)


def minus_phi_of_outages(
    system: DelaySystem, gain: Matrix, modes: Modes, *, lost: bool
) -> Inequality:
    """Return -Phi in touch, or out of touch (`lost`)."""
    loop = _out_of_touch(system, gain, modes) if lost else Loop.of(system, gain)
    n, again = loop.A[0].nrows(), modes.fallback_age > 0
    rows, now = {"x": n}, []
    for j, delay in enumerate(loop.delays):
        there = varies(delay) and not (lost and delay.feedback and not again)
        now.append(f"x{j}" if there else f"d{j}")
        rows |= dict.fromkeys([now[-1], f"d{j}"], n)
    rows |= loop.rows(bounded=modes.gamma is not None)
    form = Inequality(f"-Phi {'out of' if lost else 'in'} touch", rows)
    on = [form.row("x"), *map(form.row, now)]
    x, f = on[0], loop.rate(form, on)
    form.twice("P", x, f, -1)
    form.square("P", x, 2 * (modes.beta if lost else -modes.alpha))
    for j, (delay, d, r) in enumerate(zip(loop.delays, loop.d, modes.rho, strict=True)):
        R, end = f"R[{j}]", form.row(f"d{j}")
        form.square(f"S[{j}]", x, -1)
        form.square(f"S[{j}]", end, r)
        form.square(R, f, -d * d)
        if now[j] == f"d{j}":
            form.square(R, x - end, r)
            continue
        young, old = x - on[j + 1], on[j + 1] - end
        falls_back = lost and bool(delay.feedback)
        form.square(R, young, r * (d / exact(modes.fallback_age) if falls_back else 1))
        form.square(R, old, r)
        if not falls_back:
            form.twice(f"M[{j}]", young, old, r)
    eps = "eps_out" if lost else "eps"
    loop.subtract_gain_and_uncertainty(form, on, bounded=modes.gamma is not None, eps=eps)
    return form

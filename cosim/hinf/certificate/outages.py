"""Proved growth and decay of a loop whose link drops out: one functional for both modes.

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

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.certificate.analysis_proof import ExactLoop, exact_loop, orders_of
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json, scalings
from cosim.hinf.certificate.decay import is_above_exponential
from cosim.hinf.certificate.document import ProvedValue
from cosim.hinf.certificate.proof import require_size
from cosim.hinf.certificate.quadratic_form import Form, Map
from cosim.hinf.certificate.rational import (
    asymmetric,
    exact,
    exact_matrix,
    first_bad_matrix,
    from_text,
    identity,
    matrix_from_text,
    matrix_to_text,
    to_text,
)
from cosim.hinf.certificate.system_json import known_keys, matrix_from_rows, number

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

_KEYS = (
    *("alpha", "beta", "gamma", "rho", "fallback", "fallback_age"),
    *("P", "S", "R", "M", "eps", "eps_out"),
)
_WORDS = (
    "in touch (every age of the feedback at most its d) V' <= -2 alpha V, out of touch (u = "
    "fallback x(t - o), 0 <= o <= fallback_age) V' <= 2 beta V, one V >= x'P x for both, and so "
    "V(T) <= V(0) exp(2 beta T_out - 2 alpha T_touch) with w = 0, whichever way the time is divided"
)
_GAIN_WORDS = (
    "; from x = 0 the integral over [0, T] of s z'z is at most gamma^2 times that of s w'w, "
    "s = exp(2 alpha T_touch - 2 beta T_out) up to each instant"
)


@dataclass(frozen=True, eq=False)
class Outages(ProvedValue):
    """What is proved of a loop whose link drops out; exact numbers (`fmpq`, `fmpq_mat`).

    alpha, beta : V falls at least as e^{-2 alpha t} in touch, and grows at most as e^{2 beta t}
        out of touch [1/s]; beta may be negative.
    gamma : bound of the weighted gain from w to z; None for stability alone.
    rho : r_j per positive delay, at most e^{-2 alpha d_j}.
    fallback : (m, n) K_o of the fallback, doubles; zero for zero input.
    fallback_age : its greatest age [s], a double; 0: it acts at once.
    P, S, R, M : of the functional, S, R and M one per positive delay; M None where it is constant.
    eps, eps_out : multipliers of the uncertainty in each mode, as of an analysis.
    """

    alpha: Any
    beta: Any
    gamma: Any
    rho: tuple[Any, ...]
    fallback: Matrix
    fallback_age: float
    P: Any
    S: tuple[Any, ...]
    R: tuple[Any, ...]
    M: tuple[Any, ...]
    eps: Any
    eps_out: Any

    @property
    def share(self) -> Any:
        """The share of the time in touch above which V falls in the long run (`fmpq`)."""
        return self.beta / (self.alpha + self.beta) if self.beta > 0 else 0 * self.beta

    def claim(self) -> dict[str, Any]:
        """Return the claim that is proved if `failure` returns None."""
        more = {} if self.gamma is None else {"gamma": to_text(self.gamma)}
        return {
            "property": _WORDS + (_GAIN_WORDS if more else ""),
            "alpha": to_text(self.alpha),
            "beta": to_text(self.beta),
            "share": to_text(self.share),
            **more,
            "fallback": self.fallback.tolist(),
            "fallback_age": self.fallback_age,
        }

    def to_json(self) -> dict[str, Any]:
        """Return the JSON values that `outages_from_json` reads."""
        return {
            "alpha": to_text(self.alpha),
            "beta": to_text(self.beta),
            "gamma": None if self.gamma is None else to_text(self.gamma),
            "rho": [to_text(x) for x in self.rho],
            "fallback": self.fallback.tolist(),
            "fallback_age": self.fallback_age,
            "P": matrix_to_text(self.P),
            "S": [matrix_to_text(x) for x in self.S],
            "R": [matrix_to_text(x) for x in self.R],
            "M": [None if x is None else matrix_to_text(x) for x in self.M],
            "eps": eps_to_json(self.eps),
            "eps_out": eps_to_json(self.eps_out),
        }

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return which condition is not proved; None if all are.

        Raises
        ------
        InputError : a loop without outages (`outage_delay`), or too large a proof.
        """
        feedback = outage_delay(system)
        rows = len(system.A) * (1 + 2 * len(system.delays))
        require_size(rows + system.C.shape[1] + system.E.shape[1])
        reason = self._scalar_failure(system, feedback) or self._matrix_failure()
        forms = self._forms(system, gain) if reason is None else []
        return reason or next(filter(None, (form.failure(name) for name, form in forms)), None)

    def _scalar_failure(self, system: DelaySystem, feedback: Delay) -> str | None:
        """Return what is wrong with a number; None if nothing is."""
        if not (self.alpha > 0 and self.beta >= -self.alpha):
            return "alpha is not positive, or beta is below -alpha"
        if self.gamma is not None and not self.gamma > 0:
            return "gamma is not positive"
        if not 0 <= self.fallback_age <= feedback.d:
            return "the age of the fallback is not between 0 and that of the feedback"
        late = [x for x in system.delays if x.d > 0]
        for j, (r, delay) in enumerate(zip(self.rho, late, strict=True)):
            if not (r > 0 and is_above_exponential(1 / r, 2 * self.alpha * exact(delay.d))):
                return f"rho[{j}] is not positive, or not at most exp(-2 alpha d)"
        return None

    def _matrix_failure(self) -> str | None:
        """Return which of P, S, R is not positive definite; None if all are."""
        named = [("P", self.P)]
        for name, each in (("S", self.S), ("R", self.R)):
            named += [(f"{name}[{j}]", x) for j, x in enumerate(each)]
        bad = asymmetric(named)
        if bad is not None:
            return f"{bad} is not symmetric"
        bad = first_bad_matrix(named)
        return None if bad is None else f"{bad} is not positive definite"

    def _forms(self, system: DelaySystem, gain: Matrix) -> list[tuple[str, Form]]:
        """Return every other form that must be positive, with its name."""
        found, n = [], len(system.A)
        for j, M in enumerate(self.M):
            if M is None:
                continue
            form = Form({"v": n, "u": n})
            v, u = {"v": identity(n)}, {"u": identity(n)}
            form.square(v, self.R[j])
            form.square(u, self.R[j])
            form.twice(v, M, u)
            found.append((f"[R M[{j}]; M' R]", form))
        orders = orders_of(system, 0)
        touch = exact_loop(system, gain, orders)
        out = exact_loop(system, np.zeros_like(gain), orders)
        K, late = exact_matrix(self.fallback), self.fallback_age > 0
        acting = exact_matrix(system.B) * K, exact_matrix(system.D2) * K
        if not late:
            out = replace(
                out,
                A=[out.A[0] + acting[0], *out.A[1:]],
                D=[out.D[0] + acting[1], *out.D[1:]],
            )
        found.append(("-Phi in touch", self._minus_phi(system, touch, self.eps, None)))
        more = acting if late else ()
        return [*found, ("-Phi out of touch", self._minus_phi(system, out, self.eps_out, more))]

    def _minus_phi(
        self, system: DelaySystem, loop: ExactLoop, eps: Any, fallback: tuple[Any, ...] | None
    ) -> Form:
        """Return -Phi of one mode; `fallback` : B K_o and D2 K_o if it is late; None: in touch."""
        n, lost = len(system.A), fallback is not None
        late = [x for x in system.delays if x.d > 0]
        sizes, now = {"x": n}, []
        for j, delay in enumerate(late):
            there = varies(delay) and not (lost and delay.feedback and not fallback)
            now.append(f"x{j}" if there else f"d{j}")
            sizes |= dict.fromkeys([now[-1], f"d{j}"], n)
        f = {"x": loop.A[0]} | dict(zip(now, loop.A[1:], strict=True))
        z = {"x": loop.D[0]} | dict(zip(now, loop.D[1:], strict=True))
        q = {"x": loop.H[0]} | dict(zip(now, loop.H[1:], strict=True))
        if fallback:
            own = now[next(j for j, x in enumerate(late) if x.feedback)]
            f[own], z[own] = fallback
        if self.gamma is not None:
            sizes["w"], f["w"], z["w"] = loop.C.ncols(), loop.C, loop.D1
        if loop.blocks:
            sizes["p"], f["p"] = loop.E.ncols(), loop.E
        form, one = Form(sizes), identity(n)
        x = {"x": one}
        form.twice(x, -self.P, f)
        form.square(x, 2 * (self.beta if lost else -self.alpha) * self.P)
        for j, (delay, d) in enumerate(zip(late, loop.d, strict=True)):
            r, S, R, end = self.rho[j], self.S[j], self.R[j], {f"d{j}": one}
            form.square(x, -S)
            form.square(end, r * S)
            form.square(f, -d * d * R)
            if now[j] == f"d{j}":
                form.square({"x": one, f"d{j}": -one}, r * R)
                continue
            young, old = {"x": one, f"x{j}": -one}, {f"x{j}": one, f"d{j}": -one}
            again = lost and bool(delay.feedback)
            form.square(young, r * (d / exact(self.fallback_age) if again else 1) * R)
            form.square(old, r * R)
            if not again:
                form.twice(young, r * self.M[j], old)
        if loop.blocks:
            L_p, L_q = scalings(loop.blocks, eps)
            form.square(q, -L_q)
            form.square({"p": identity(sizes["p"])}, L_p)
        if self.gamma is not None:
            form.square(z, -1 / self.gamma * identity(loop.D1.nrows()))
            w: Map = {"w": identity(sizes["w"])}
            form.square(w, self.gamma * identity(sizes["w"]))
        return form


def varies(delay: Delay) -> bool:
    """Whether a delay is one of any age here: the plant's, if it is so given, or the feedback's."""
    return delay.any_age or bool(delay.feedback)


def outage_delay(system: DelaySystem) -> Delay:
    """Return the delay through which the control acts, which an outage cuts.

    Raises
    ------
    InputError : no control acts through a positive delay, or not all of it through one, or
        something else acts through it.
    """
    acting = [x for x in system.delays if x.feedback and x.d > 0]
    wrong = None
    if not acting:
        wrong = "no control acts through a positive delay"
    elif acting[0].feedback is not True or system.is_structured:
        wrong = "states that are fed back at different ages, or not at all"
    elif acting[0].A.any() or acting[0].H.any():
        wrong = "the plant itself acts through the delay of the feedback"
    if wrong is not None:
        raise InputError(
            "outages are those of one link with all of the feedback",
            where=f"system {system.name}" if system.name else "system",
            expected="u = K x(t - d) with one positive delay, through which nothing else acts",
            got=wrong,
        )
    return acting[0]


def outages_from_json(data: Any, system: DelaySystem, where: str) -> Outages:
    """Read what `Outages.to_json` wrote.

    Raises
    ------
    InputError : a missing key, a wrong shape, a text that is no number.
    """
    known_keys(data, where, _KEYS, required=_KEYS)
    n, m = system.B.shape
    late = [x for x in system.delays if x.d > 0]
    for name in ("rho", "S", "R", "M"):
        if not isinstance(data[name], list) or len(data[name]) != len(late):
            expected = f"a list of {len(late)}"
            raise InputError("one per positive delay", where=f"{where}.{name}", expected=expected)
    for j, delay in enumerate(late):
        if (data["M"][j] is None) == varies(delay):
            expected = "a matrix" if varies(delay) else "null: the delay is constant"
            raise InputError("does not fit the delay", where=f"{where}.M[{j}]", expected=expected)
    if data["gamma"] is not None and not system.has_performance:
        raise InputError("this system has no gain to bound", where=f"{where}.gamma")
    fallback = matrix_from_rows(data["fallback"], f"{where}.fallback")
    if fallback.shape != (m, n):
        got = str(fallback.shape)
        raise InputError("wrong shape", where=f"{where}.fallback", expected=str((m, n)), got=got)

    def matrices(name: str) -> tuple[Any, ...]:
        return tuple(
            None if x is None and name == "M" else matrix_from_text(x, f"{where}.{name}[{j}]", n, n)
            for j, x in enumerate(data[name])
        )

    return Outages(
        alpha=from_text(data["alpha"], f"{where}.alpha"),
        beta=from_text(data["beta"], f"{where}.beta"),
        gamma=None if data["gamma"] is None else from_text(data["gamma"], f"{where}.gamma"),
        rho=tuple(from_text(x, f"{where}.rho[{j}]") for j, x in enumerate(data["rho"])),
        fallback=fallback,
        fallback_age=number(data["fallback_age"], f"{where}.fallback_age"),
        P=matrix_from_text(data["P"], f"{where}.P", n, n),
        S=matrices("S"),
        R=matrices("R"),
        M=matrices("M"),
        eps=eps_from_json(system, data["eps"], f"{where}.eps"),
        eps_out=eps_from_json(system, data["eps_out"], f"{where}.eps_out"),
    )

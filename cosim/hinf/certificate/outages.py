"""Proved growth and decay of a loop whose link drops out: the guarantee, its words and its JSON.

The inequalities are those of `cosim.hinf.theorems.outages`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.core import InputError
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json
from cosim.hinf.certificate.decay import is_above_exponential
from cosim.hinf.certificate.document import ProvedValue
from cosim.hinf.certificate.proof import require_size
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.certificate.system_parts import matrix_from_rows, number
from cosim.hinf.exact import asymmetric, exact, from_text, matrix_from_text, matrix_to_text, to_text
from cosim.hinf.theorems import (
    Modes,
    eps_by_name,
    first_failure,
    gamma_by_name,
    outage_inequalities,
    varies,
)

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
class Outages(Modes, ProvedValue):
    """What is proved of a loop whose link drops out; exact numbers (`fmpq`, `fmpq_mat`).

    P, S, R, M : of the functional, S, R and M one per positive delay; M None where it is constant.
    eps, eps_out : multipliers of the uncertainty in each mode, as of an analysis.
    """

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
        reason = self._scalar_failure(system, feedback)
        if reason is not None:
            return reason
        values = self.by_name()
        bad = asymmetric([(k, M) for k, M in values.items() if k[:1] in "PSR"])
        if bad is not None:
            return f"{bad} is not symmetric"
        return first_failure(outage_inequalities(system, gain, self), values)

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

    def by_name(self) -> dict[str, Any]:
        """Return the unknowns of the inequalities by name."""
        found = {"P": self.P} | gamma_by_name(self.gamma)
        for name in ("S", "R", "M"):
            found |= {f"{name}[{j}]": x for j, x in enumerate(getattr(self, name))}
        return found | eps_by_name(self.eps) | eps_by_name(self.eps_out, "eps_out")


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

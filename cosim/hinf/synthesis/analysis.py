"""Certify the least gamma, or the stability, of a given gain or of the system without control.

As in `cosim.hinf.synthesis.synthesis`: the solver's least gamma, then a little above it a point
of great margin, then the exact proof; where that fails, a little higher. The conditions
(`conditions`) are tried in turn, the sharpest first.

"Not certified" is a result, not an error: the conditions are sufficient only. The figures of
the nominal loop are given beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.hinf.certificate import MAX_BOX, MAX_ORDER, check_measured, covers_smaller
from cosim.hinf.lmi import not_found, solver_words
from cosim.hinf.nominal import NominalFigures, checked_system, nominal_figures_of
from cosim.hinf.synthesis.conditions import Condition, conditions_of, prove
from cosim.models import DelaySystem

_ABOVE_LEAST = (2e-6, 1e-5, 5e-5, 3e-4, 2e-3, 1e-2, 5e-2)


@dataclass(frozen=True, eq=False)
class Analysis:
    """The result of an analysis: what is certified of a loop, and its nominal figures.

    Attributes
    ----------
    system : the system, at the delays that are analysed.
    K : (m, n) the gain, as its doubles; None for u = 0.
    order : of the Bessel-Legendre inequality; 0 is Theorem 1.
    certified : whether anything is proved.
    reason : why nothing is; None if something is.
    gamma : certified bound of the gain from w to z, uncertainty included; None where only
        stability is certified, or nothing.
    least_gamma : the solver's least gamma: not a proof; None where it finds none.
    abscissa, exact_norm, exact_norm_upper, norm_frequency, delay_margin : of the nominal loop
        (`cosim.hinf.nominal.nominal_figures`).
    certificate : the proof as JSON values, for `check_certificate`; None if not certified.
    """

    system: DelaySystem
    K: NDArray[np.float64] | None
    order: int
    certified: bool
    reason: str | None
    gamma: float | None
    least_gamma: float | None
    abscissa: float
    exact_norm: float | None
    exact_norm_upper: float | None
    norm_frequency: float | None
    delay_margin: tuple[float | None, ...] | None
    certificate: dict[str, Any] | None

    @property
    def covers_smaller_delays(self) -> bool:
        """Whether the proof covers every delay up to the system's, not exactly these alone."""
        return self.certificate is not None and covers_smaller(self.certificate["claim"])


def analyse(
    system: DelaySystem,
    gain: ArrayLike | None = None,
    gamma: float | None = None,
    *,
    order: int = 0,
) -> Analysis:
    """Certify the least gamma of u = K x, or stability where there is no w or no z.

    Parameters
    ----------
    system : Eq. (7) with any number of delays (n states, m inputs).
    gain : (m, n) K; None for u = 0.
    gamma : a bound to prove instead of the least one.
    order : 0 for Theorem 1, which covers every constant delay up to the system's; N > 0 for the
        Bessel-Legendre condition of order N, which covers exactly these delays, or every one up
        to them if that can be proved at the same gamma (`Analysis.covers_smaller_delays`). Ages
        are taken as they are from order 1 on, and at any order where more is known of one than
        its bound (`cosim.hinf.synthesis.conditions`).

    Raises
    ------
    InputError : numbers that do not fit the system.
    """
    system = checked_system(system)
    K = gain_of(system, gain)
    check_order_of_analysis(order)
    if gamma is not None:
        check_gamma(gamma, system)
    found = analysed(system, K, gamma, order, nominal_figures_of(system, K))
    return found if gain is not None else replace(found, K=None)


def analysed(
    system: DelaySystem,
    K: NDArray[np.float64],
    gamma: float | None,
    order: int,
    nominal_figures: NominalFigures,
) -> Analysis:
    """Analyse a gain whose nominal figures are known, as `analyse`."""
    delays = [delay.d for delay in system.delays]
    proof, level, reason = None, None, None
    leasts: list[float] = []
    if nominal_figures.abscissa >= 0 and not any(delay.sampled for delay in system.delays):
        conditions = []
        reason = _unstable(nominal_figures.abscissa)
    else:
        conditions = conditions_of(system, K, order, performance=system.has_performance)
    floor = float(np.linalg.norm(system.D1, 2))
    reference = max(floor, nominal_figures.exact_norm or 0.0) or 1.0
    for condition in conditions:
        levels: list[float | None] = [gamma]
        if system.has_performance:
            with solver_words() as words:
                least = condition.least_gamma(delays, reference)
            leasts += [] if least is None else [least]
            if gamma is None and least is None:
                reason = reason or f"no gamma was found: {not_found(words)}"
                continue
            if gamma is None and least is not None:
                levels = [float(f"{least * (1 + share):.7g}") for share in _ABOVE_LEAST]
        for level in levels:
            proof, why_not = prove(condition, system, K, delays, level)
            if proof is not None:
                proof = widened(system, K, condition, level) or proof
                break
            reason = why_not
        if proof is not None:
            break
    return Analysis(
        system=system,
        K=K,
        order=order,
        certified=proof is not None,
        reason=None if proof is not None else reason,
        gamma=None if proof is None else level,
        least_gamma=leasts[-1] if leasts else None,
        certificate=proof,
        **nominal_figures._asdict(),
    )


def _unstable(abscissa: float) -> str:
    return f"the nominal loop is not stable: its rightmost root has real part {abscissa:.6g}"


class Prover:
    """Certified feasibility of one loop at one order, for any delays: the LMI is set up once.

    Parameters
    ----------
    system : Eq. (7); its delays are the ones that are replaced.
    K : (m, n).
    order : N.
    gamma : the gain to prove; None for stability alone.

    `reason` says why the last `proof` was None.
    """

    def __init__(
        self, system: DelaySystem, K: NDArray[np.float64], order: int, gamma: float | None
    ) -> None:
        self._K, self._gamma = K, gamma
        self.reason: str | None = None
        self._conditions = conditions_of(system, K, order, performance=gamma is not None)

    def proof(self, system: DelaySystem) -> dict[str, Any] | None:
        """Return the certificate of `system`, other delays of the same loop; None without one.

        The first condition that proves one is kept for the other delays.
        """
        delays = [delay.d for delay in system.delays]
        reasons = []
        for condition in self._conditions:
            found, reason = prove(condition, system, self._K, delays, self._gamma)
            if found is not None:
                self._conditions = [condition]
                return found
            reasons.append(reason)
        self.reason = reasons[0]
        return None

    def widened(self, system: DelaySystem) -> dict[str, Any] | None:
        """Return a certificate for every delay up to the system's, as `widened`; None without."""
        return widened(system, self._K, self._conditions[0], self._gamma)


def widened(
    system: DelaySystem, K: NDArray[np.float64], condition: Condition, gamma: float | None
) -> dict[str, Any] | None:
    """Return a certificate for every constant delay up to the system's; None without one.

    Also None at order 0, where the certificate of these delays covers smaller ones.
    """
    box = sum(delay.d > 0 and not delay.any_age for delay in system.delays)
    if condition.order == 0 or not 0 < box <= MAX_BOX:
        return None
    delays = [delay.d for delay in system.delays]
    return prove(condition, system, K, delays, gamma, down_to_zero=True)[0]


def gain_of(system: DelaySystem, gain: ArrayLike | None) -> NDArray[np.float64]:
    """Return K as (m, n) doubles, zero for None.

    Raises
    ------
    InputError : it does not fit the system.
    """
    n, m = system.B.shape
    if gain is None:
        return np.zeros((m, n))
    try:
        K = np.array(gain, dtype=np.float64)
    except (TypeError, ValueError):
        K = np.full((1, 1), np.nan)
    if not m and K.size:
        raise InputError(
            "this gain acts on nothing: the system has no control, B is missing",
            where=f"{system.name}: B" if system.name else "B",
            expected=f"B, {n} rows with one column per control",
            got="no B",
            hint="give B beside A, or leave the gain out",
        )
    if K.shape != (m, n) or not np.isfinite(K).all():
        raise InputError(
            "the gain does not fit the system",
            where="gain",
            expected=f"{m} rows of {n} finite numbers",
            got=f"shape {np.shape(K)}" if np.isfinite(K).all() else "not only finite numbers",
        )
    check_measured(K, system)
    return K


def check_order_of_analysis(order: int) -> None:
    """Refuse an order out of range.

    Raises
    ------
    InputError : naming the range.
    """
    if not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where="order",
            expected=f"0 (Theorem 1) to {MAX_ORDER}",
            got=str(order),
        )


def check_gamma(gamma: float, system: DelaySystem) -> None:
    """Refuse a gamma that is not positive, and any gamma of a system without w and z.

    Raises
    ------
    InputError : naming which.
    """
    if not (np.isfinite(gamma) and gamma > 0):
        raise InputError("gamma must be a positive number", where="gamma", got=repr(gamma))
    if not system.has_performance:
        raise InputError(
            "this system has no gain to bound",
            where="gamma",
            expected="a system with C and with D, D1 or D2",
            got=f"{gamma:g}",
        )

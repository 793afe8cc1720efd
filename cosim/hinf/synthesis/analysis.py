"""Certify the least gamma, or the stability, of a given gain or of the system without control.

As in `cosim.hinf.synthesis.synthesis`: the solver's least gamma, then a little above it a point
of great margin, then the exact proof; where that fails, a little higher. The conditions
(`conditions`) are tried in turn, the sharpest first, at every order that is affordable, and the
best proof is claimed.

"Not certified" is a result, not an error: the conditions are sufficient only. The figures of
the nominal loop are given beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, counted, html_table, matrix_text
from cosim.hinf.certificate import (
    Certificate,
    Damping,
    Guarantees,
    check_measured,
    checked_damping,
    covers_smaller,
)
from cosim.hinf.lmi import Condition, not_found, solver_words
from cosim.hinf.nominal import (
    BEYOND,
    HasFigures,
    NominalFigures,
    Verdict,
    checked_system,
    figures_if_known,
    verdict_of,
)
from cosim.hinf.problem import ages_are_known
from cosim.hinf.synthesis.conditions import (
    AFFORDABLE_ORDERS,
    affordable_conditions,
    conditions_of,
    is_large,
    prove,
    widened,
)
from cosim.hinf.synthesis.ladder import FAR, clearly_below, least_proved
from cosim.hinf.synthesis.result_text import proved_words, result_rows
from cosim.hinf.synthesis.same_as_proved import require_proved_gain
from cosim.hinf.theorems import MAX_ORDER
from cosim.models import DelaySystem, Matrix, Value

_ABOVE_LEAST = (2e-6, 1e-5, 5e-5, 3e-4, 2e-3, 1e-2, 5e-2, *FAR)
_COSTLY = 500
"""Unknowns from which a proof takes seconds: the finest levels above the least gamma are left."""
_FIRST_IF_COSTLY = 3
_MUCH = 0.1  # share of gamma worth a proof of exactly these delays, or an odd gain


@dataclass(frozen=True, eq=False, repr=False)
class Analysis(HasFigures, Value):
    """The result of an analysis: what is certified of a loop, and its nominal figures.

    It cannot be changed, and two are equal where everything they say is.

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
    figures : of the nominal loop. They are attributes of the analysis too, `abscissa`,
        `exact_norm`, `exact_norm_upper`, `norm_frequency`, `delay_margin` and `worst_case`: see
        `NominalFigures`.
    certificate : the proof as JSON values, for `check_certificate`; None if not certified.
    guarantees : the damping, where it was asked for and is proved; also in the certificate, if
        there is one.
    damping_reason : why the damping that was asked for is not proved; None if it is, or none was.

    Raises
    ------
    InputError : made with a system, gain, bound or guarantee that is not the certificate's.
    """

    system: DelaySystem
    K: NDArray[np.float64] | None
    order: int
    certified: bool
    reason: str | None
    gamma: float | None
    least_gamma: float | None
    figures: NominalFigures
    certificate: dict[str, Any] | None
    guarantees: Guarantees = field(default_factory=Guarantees)
    damping_reason: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.certified != (self.certificate is not None):
            raise InputError(
                "what is said is not what is proved",
                where="certified",
                expected="a certificate where something is proved, none where nothing is",
                got=f"certified = {self.certified}",
            )
        if self.certificate is not None:
            object.__setattr__(self, "certificate", Certificate(self.certificate))
            stated = {"gamma": self.gamma, "order": self.order}
            require_proved_gain(self.certificate, self.system, self.K, stated, self.guarantees)

    def __repr__(self) -> str:
        name = f" {self.system.name!r}" if self.system.name else ""
        gain = "u = 0" if self.K is None else f"K = {matrix_text(self.K)}"
        return f"<Analysis{name}: {gain}, {proved_words(self)}>"

    def _repr_html_(self) -> str:
        """Return what is proved and the figures of the nominal loop, as notebooks show them."""
        return html_table(repr(self), {"system": repr(self.system)[1:-1], **result_rows(self)})

    @property
    def covers_smaller_delays(self) -> bool:
        """Whether the proof covers every delay up to the system's, not exactly these alone."""
        return self.certificate is not None and covers_smaller(self.certificate["claim"])

    @property
    def verdict(self) -> Literal["certified"] | Verdict:
        """What is decided: "certified", "unstable" (proved for the nominal loop), "undecided"."""
        if self.certified:
            return "certified"
        if (
            self.abscissa is None
            or self.abscissa < 0
            or any(delay.sampled for delay in self.system.delays)
        ):
            return "undecided"
        return verdict_of(self.system, gain_of(self.system, self.K), self.abscissa)[0]


Order = int | Literal["auto"]


def analyse(
    system: DelaySystem,
    gain: ArrayLike | None = None,
    gamma: float | None = None,
    *,
    order: Order = "auto",
    damping: float | None = None,
    within: float | None = None,
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
        its bound (`cosim.hinf.synthesis.conditions`). "auto": the best proof of the orders that
        take a few seconds at most.
    damping, within : also prove that every characteristic root s of the nominal loop with
        Re s >= -within [1/s] has a damping ratio above `damping`, between 0 and 1.

    Raises
    ------
    InputError : numbers that do not fit the system. A gain of any size is none of these: where
        numbers leave the range of doubles, the verdict is "undecided", and `reason` says why.
    """
    system = checked_system(system)
    K = gain_of(system, gain)
    check_order_of_analysis(order)
    if gamma is not None:
        check_gamma(gamma, system)
    asked = checked_damping(system, damping, within)
    figures, unknown = figures_if_known(system, K)
    try:
        with np.errstate(over="raise", invalid="raise"):
            analysis = best_analysis(system, K, gamma, order, figures)
        if unknown is not None and not analysis.certified:
            analysis = replace(analysis, reason=f"{unknown}; {analysis.reason}")
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        reason = unknown or f"{BEYOND} ({error}): choose other units"
        first = AFFORDABLE_ORDERS[0] if order == "auto" else order
        nothing: dict[str, Any] = dict.fromkeys(("gamma", "least_gamma", "certificate"))
        analysis = Analysis(system, K, first, False, reason, **nothing, figures=figures)  # noqa: FBT003
    if asked is not None:
        analysis = _with_damping(analysis, K, asked)
    return analysis if gain is not None else replace(analysis, K=None)


def _with_damping(analysis: Analysis, K: Matrix, asked: Damping) -> Analysis:
    """Return an analysis with the damping that is proved of its gain, or why it is not."""
    reason = asked.failure(analysis.system, K)
    if reason is not None:
        return replace(analysis, damping_reason=reason)
    proved, certificate = Guarantees(damping=asked), analysis.certificate
    certificate_with_it = None if certificate is None else proved.beside(certificate)
    return replace(analysis, guarantees=proved, certificate=certificate_with_it)


def check_order_of_analysis(order: Order) -> None:
    """Refuse an order out of range.

    Raises
    ------
    InputError : naming the range.
    """
    if order != "auto" and not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where="order",
            expected=f"0 (Theorem 1) to {MAX_ORDER}",
            got=str(order),
        )


def best_analysis(
    system: DelaySystem,
    K: Matrix,
    gamma: float | None,
    order: Order,
    figures: NominalFigures,
    *,
    ranking: bool = False,
    below: float | None = None,
) -> Analysis:
    """Return the best proof of this order or of all; where there is none, what came nearest.

    ranking : of all orders only what is quick, to compare gains with each other.
    below : a gamma that is proved already: only what is clearly less is tried.
    """
    made: list[Analysis] = []
    root = figures.abscissa
    excluded = root is not None and root >= 0 and not any(x.sampled for x in system.delays)
    bounded = system.has_performance
    known = ages_are_known(system) or is_large(system, K)
    orders = [order] if order != "auto" else [1, 0] if known else [*AFFORDABLE_ORDERS]
    if ranking and known:
        orders = sorted(orders)  # the quick one first
    for each in orders:
        conditions: list[Condition] = []
        if order == "auto" and not excluded:
            conditions = affordable_conditions(
                system, K, each, performance=bounded, ranking=ranking
            )
        elif not excluded:
            conditions = conditions_of(system, K, each, performance=bounded)
        if not conditions and not excluded:
            continue
        last = _analysed(system, K, gamma, each, conditions, figures, below)
        made.append(last)
        if last.gamma is not None:
            below = min(_worth(last), np.inf if below is None else below)
        asked = gamma is not None or last.gamma is None
        if last.certified and (asked or is_exact(last) or (known and not _is_far(last))):
            break
    certified = [one for one in made if one.certified]
    if certified:
        return preferred(certified)
    return min(made, key=lambda one: np.inf if one.least_gamma is None else one.least_gamma)


class Claim(Protocol):
    """What designs and analyses have in common."""

    @property
    def gamma(self) -> float | None:
        """The certified bound."""

    @property
    def abscissa(self) -> float | None:
        """Of the nominal loop; None where it could not be computed."""

    @property
    def exact_norm(self) -> float | None:
        """Of the nominal loop."""

    @property
    def covers_smaller_delays(self) -> bool:
        """Whether the proof covers every delay up to the system's."""


Claimed = TypeVar("Claimed", bound=Claim)


def preferred(claims: Sequence[Claimed]) -> Claimed:
    """Return the claim of least gamma; where little is lost, one that covers smaller delays.

    So too one whose nominal figures can be computed: otherwise its gain is out of all proportion.
    """
    return min(claims, key=_worth)


def _worth(one: Claim) -> float:
    """Return the gamma of a claim that covers smaller delays and is worth as much."""
    worse = (not one.covers_smaller_delays) + 2 * (one.abscissa is None)
    return (one.gamma or 0.0) * (1.0 + _MUCH) ** worse


def is_exact(claim: Claim) -> bool:
    """Whether no analysis of the same gain can be sharper: gamma is the nominal norm."""
    return bool(claim.exact_norm and (claim.gamma or 0.0) < claim.exact_norm * (1 + 1e-3))


def _is_far(one: Analysis) -> bool:
    """Return whether a gamma is proved far above the least one: another order may do better."""
    if one.gamma is None or one.least_gamma is None:
        return False
    return one.gamma > one.least_gamma * (1.0 + FAR[0] / 2)


def _analysed(
    system: DelaySystem,
    K: Matrix,
    gamma: float | None,
    order: int,
    conditions: Sequence[Condition],
    figures: NominalFigures,
    below: float | None,
) -> Analysis:
    """Analyse a gain whose nominal figures are known, by conditions of one order.

    below : as in `best_analysis`.
    """
    delays = [delay.d for delay in system.delays]
    proof, level, reason = None, None, None
    leasts: list[float] = []
    if not conditions:
        reason = verdict_of(system, K, figures.abscissa or 0.0)[1]
    floor = float(np.linalg.norm(system.D1, 2))
    reference = max(floor, figures.exact_norm or 0.0) or 1.0
    for condition in conditions:
        at_level = partial(prove, condition, system, K)
        if system.has_performance:
            with solver_words() as words:
                least = condition.least_gamma(delays, reference)
            leasts += [] if least is None else [least]
            if gamma is None and least is None:
                reason = reason or f"no gamma was found: {not_found(words)}"
                continue
        if gamma is None and leasts:
            costly = condition.unknowns(delays) > _COSTLY
            shares = _ABOVE_LEAST[_FIRST_IF_COSTLY:] if costly else _ABOVE_LEAST
            levels = clearly_below(
                (float(f"{leasts[-1] * (1 + share):.7g}") for share in shares), below
            )
            reason = f"nothing clearly below gamma = {below} was found"
            if not levels:
                continue
            proved, reason = least_proved(levels, at_level)
            level, proof = proved or (None, None)
        else:
            level = gamma
            proof, reason = at_level(gamma)
        if proof is not None:
            proof = widened(condition, system, K, level) or proof
            break
    return Analysis(
        system=system,
        K=K,
        order=order,
        certified=proof is not None,
        reason=None if proof is not None else reason,
        gamma=None if proof is None else level,
        least_gamma=(leasts[-1] if proof is not None else min(leasts)) if leasts else None,
        certificate=proof,
        figures=figures,
    )


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
            expected=f"{counted(m, 'row')} of {counted(n, 'finite number')}",
            got=f"shape {np.shape(K)}" if np.isfinite(K).all() else "not only finite numbers",
        )
    check_measured(K, system)
    return K


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

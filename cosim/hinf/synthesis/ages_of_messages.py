"""How old the messages of a loop may be: one table, and one ordered list of limits.

The delay of the feedback is varied. For each age a gain is designed (or the given one kept) and
proved; beside it stand the exact figures of the nominal loop. For one gain, that of the present
age, the limits are computed, from the assumption that asks least of the messages to the one that
asks most: any age, sampled, constant, and the constant age at which the nominal loop loses
stability. What is proved under an assumption never lies beyond the exact limit of a constant age,
but for sampled ages, whose mean is only half as old.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, NotAchievableError, Progress, counted, html_table, silent
from cosim.hinf.delay_lti import (
    checked_system,
    one_thread,
)
from cosim.hinf.problem import DELAY_LIMIT, DesignConstraints, refuse_structure
from cosim.hinf.synthesis.alternatives import RefusedDesign, alternatives_of, what_else
from cosim.hinf.synthesis.analysis import analyse, gain_of
from cosim.hinf.synthesis.certified_delays import certified_age
from cosim.hinf.synthesis.gain_design import design
from cosim.hinf.synthesis.result import Result
from cosim.models import Delay, DelaySystem

Assumption = Literal["any", "sampled", "constant"]
"""What may be known of an age beside its bound."""

ASSUMPTIONS: tuple[Assumption, ...] = ("any", "sampled", "constant")

_SHARES = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
_OF_PACE = (0.1, 0.2, 0.3, 0.45, 0.6, 0.8)
_PRECISION = 2e-3  # of the limits, relative


@dataclass(frozen=True, eq=False, repr=False)
class AgeRow:
    """The loop with messages of one greatest age.

    Attributes
    ----------
    age : greatest age [s].
    K : (m, n) the gain; None if none was found.
    gamma : certified; None without a proof (or without w and z).
    exact_norm : of the nominal loop with this constant age; of a sampled age, with its mean.
    control : exact norm from w to u of the same loop: control (thrust) per disturbance.
    margin : constant age at which this gain's nominal loop loses stability [s]; None: never.
    stable : whether the nominal loop is stable.
    reason : why there is no proof; None with one.
    """

    age: float
    K: NDArray[np.float64] | None
    gamma: float | None
    exact_norm: float | None
    control: float | None
    margin: float | None
    stable: bool
    reason: str | None

    def __repr__(self) -> str:
        verdict = "certified" if self.certified else f"not certified: {self.reason}"
        gamma = "" if self.gamma is None else f"gamma {self.gamma:.6g} "
        return f"<AgeRow: {self.age:g} s, {gamma}{verdict}>"

    @property
    def certified(self) -> bool:
        """Whether there is a proof."""
        return self.reason is None


@dataclass(frozen=True)
class AgeLimit:
    """How old messages may be under one assumption.

    Attributes
    ----------
    assumption : "any", "sampled" or "constant" (each certified), or "exact" (computed).
    age : greatest age [s]; None: none is certified, or for "exact": no limit.
    limit_reached : whether the search ended there, so that older ones may be certified too.
    """

    assumption: Assumption | Literal["exact"]
    age: float | None
    limit_reached: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class MessageAges:
    """The answer to how old the messages of a loop may be.

        >>> from cosim.hinf import DelaySystem, message_ages
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1], [0]], D2=[[0], [1]])
        >>> ages = message_ages(system, ages=[0.5], gain=[[-1.0]])
        >>> [(row.age, row.certified, row.gamma < 1.7) for row in ages.rows]
        [(0.5, True, True)]
        >>> [limit.assumption for limit in ages.limits]
        ['any', 'sampled', 'constant', 'exact']

    Attributes
    ----------
    system : with the delay that is varied.
    delay_index : its index.
    assumption, least_age : the kind of age that the rows assume, and its least value [s].
    gamma : the bound that rows and limits had to meet, or None.
    rows : by age.
    age, K : the age [s] whose gain the limits are of, and this gain.
    limits : of K, from the weakest assumption to the strongest.
    """

    system: DelaySystem
    delay_index: int
    assumption: Assumption
    least_age: float
    gamma: float | None
    rows: tuple[AgeRow, ...]
    age: float
    K: NDArray[np.float64]
    limits: tuple[AgeLimit, ...]

    def __repr__(self) -> str:
        limits = ", ".join(
            f"{x.assumption} {'-' if x.age is None else f'{x.age:.4g} s'}" for x in self.limits
        )
        ages = counted(len(self.rows), "age")
        return f"<MessageAges: {ages}, the gain for {self.age:g} s stands {limits}>"

    def _repr_html_(self) -> str:
        """Return the rows and limits, as notebooks show them."""
        rows = {f"{row.age:g} s": repr(row)[9:-1].split(", ", 1)[1] for row in self.rows}
        return html_table(repr(self), rows)


@one_thread
def message_ages(
    system: DelaySystem,
    k1: Sequence[float] | None = None,
    k2: Sequence[float] | None = None,
    *,
    ages: Sequence[float] | None = None,
    gain: ArrayLike | None = None,
    gamma: float | None = None,
    assumption: Assumption | None = None,
    least_age: float = 0.0,
    own_age: float | None = None,
    limit: float = DELAY_LIMIT,
    report_progress: Progress = silent,
) -> MessageAges:
    """Compute what messages of each age cost, and how old they may be.

        >>> from cosim.hinf import DelaySystem, message_ages
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1], [0]], D2=[[0], [1]])
        >>> found = message_ages(system, ages=[0.5], gain=[[-1.0]])
        >>> {limit.assumption: round(limit.age, 1) for limit in found.limits}
        {'any': 1.3, 'sampled': 2.0, 'constant': 1.5, 'exact': 1.5}

    Parameters
    ----------
    system : Eq. (7). Where the control acts through no delay, one is added; k1, k2 are then
        searched.
    k1, k2 : one number per delay; without both, they are searched.
    ages : greatest ages to compute [s]; None: about the present one, or of the system's pace.
    gain : (m, n) a gain to keep; None: one is designed for each age.
    gamma : a bound to meet.
    assumption : what is known of the age; None: what the system says, else "any".
    least_age : [s], with "sampled" and "any".
    own_age : the age [s] whose gain the limits are of; None: the present one, or else the middle
        one of those that are proved.
    limit : where the search for limits ends [s].

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no gain was found at any of the ages.
    """
    system, index, has_feedback = _with_feedback(checked_system(system, control=True))
    if not has_feedback:
        k1 = k2 = None
    known = system.delays[index]
    if assumption is None:
        assumption = (
            "sampled"
            if known.sampled
            else "any"
            if known.any_age or not has_feedback
            else "constant"
        )
        least_age = least_age or known.least_age
    if ages is None:
        ages = _ages(system, index, least_age)
    ages = _checked(ages, least_age)
    rows = []
    for number, age in enumerate(ages):
        report_progress(f"messages {age:g} s old", number / (len(ages) + 4))
        at = _at(system, index, age, assumption, least_age)
        rows.append(_row(at, index, k1, k2, gain, gamma))
    proved = [row for row in rows if row.certified]
    if not proved:
        youngest = _at(system, index, ages[0], assumption, least_age)
        raise _none_proved(youngest, index, ages, rows[0].reason, k1, k2, gain, gamma)
    middle = proved[len(proved) // 2]
    present = (known.d if has_feedback else 0.0) if own_age is None else own_age
    chosen = min(proved, key=lambda row: abs(row.age - present)) if present else middle
    limits: list[AgeLimit] = []
    proved_for = chosen.age  # what is proved for any age is so for others
    for number, one in enumerate(ASSUMPTIONS):
        report_progress(f"limit, {one}", (len(ages) + number) / (len(ages) + 4))
        limits.append(_limit(system, index, chosen, gamma, one, least_age, limit, proved_for))
        proved_for = limits[0].age or chosen.age
    report_progress("exact limit", (len(ages) + 3) / (len(ages) + 4))
    limits.append(AgeLimit("exact", chosen.margin))
    return MessageAges(
        *(system, index, assumption, least_age, gamma, tuple(rows)),
        *(chosen.age, gain_of(system, chosen.K), tuple(limits)),
    )


def _none_proved(
    youngest: DelaySystem,
    index: int,
    ages: Sequence[float],
    reason: str | None,
    k1: Sequence[float] | None,
    k2: Sequence[float] | None,
    gain: ArrayLike | None,
    gamma: float | None,
) -> NotAchievableError:
    """Return the error for ages of which none is proved, with one that is.

    youngest : the system with the least of the ages.
    """

    def design_at(there: DelaySystem, bound: float | None, _: DesignConstraints) -> Result:
        return design(there, k1, k2, gamma=bound, gain=gain, alternatives=False)

    no_more = DesignConstraints()
    can = alternatives_of(RefusedDesign(youngest, gamma, k1, k2, "auto", gain, no_more, design_at))
    age = None if can.delays is None else can.delays[index]
    hints = [] if can.gamma is None else [f"gamma = {can.gamma:g}, which is certified"]
    hints += [] if age is None else [f"an age of {age:g} s, which is certified"]
    got = str(reason)
    if can.least is not None:
        got += f"; no age of {can.least[index]:g} s or more could be certified either"
    return NotAchievableError(
        "no gain is proved at any of these ages",
        where=youngest.name or None,
        expected=f"messages of {' or '.join(f'{age:g}' for age in ages)} s to be young enough",
        got=got,
        hint=(", and " if can.together else ", or ").join(hints) or what_else(youngest),
        delays=None if age is None else (age,),
        gamma=can.gamma,
        together=can.together,
    )


def _with_feedback(system: DelaySystem) -> tuple[DelaySystem, int, bool]:
    """Return the system with a delay of the feedback, its index, and whether it was there."""
    for index, delay in enumerate(system.delays):
        if delay.feedback:
            return system, index, True
    refuse_structure(system, "a delay for all feedback", "give the delay in the system")
    n = len(system.A)
    more = Delay(0.0, np.zeros((n, n)), feedback=True, any_age=True)
    return replace(system, delays=(*system.delays, more)), len(system.delays), False


def _at(
    system: DelaySystem, index: int, age: float, assumption: Assumption, least_age: float
) -> DelaySystem:
    """Return the system with messages of this greatest age."""
    kinds: dict[Assumption, dict[str, Any]] = {
        "any": {"any_age": True, "least_age": least_age, "sampled": False},
        "sampled": {"any_age": True, "least_age": least_age, "sampled": True},
        "constant": {"any_age": False, "least_age": 0.0, "sampled": False},
    }
    rate = system.delays[index].rate if assumption == "any" else None
    delay = replace(system.delays[index], d=age, rate=rate, **kinds[assumption])
    delays = (*system.delays[:index], delay, *system.delays[index + 1 :])
    return replace(system, delays=delays)


def _checked(ages: Sequence[float], least_age: float) -> list[float]:
    """Return the ages, each once and sorted.

    Raises
    ------
    InputError : there is none, or one is no age above the least.
    """
    for age in ages:
        if not (math.isfinite(age) and age > least_age):
            raise InputError(
                "not an age of messages",
                where="ages",
                expected=f"seconds, more than {least_age:g}",
                got=f"{age!r}",
            )
    if not ages:
        raise InputError("no age to compute", where="ages", expected="one or more, in seconds")
    return sorted(set(ages))


def _ages(system: DelaySystem, index: int, least_age: float) -> list[float]:
    """Return ages worth a look: about the present one, or else of the pace of the system."""
    present = system.delays[index].d
    if present > 0.0:
        return [least_age + share * (present - least_age) for share in _SHARES]
    A = system.A + sum(delay.A for delay in system.delays)
    fastest = float(np.abs(np.linalg.eigvals(A)).max())
    pace = 1.0 / (fastest or float(np.linalg.norm(A, 2)) or 1.0)
    return [least_age + float(f"{share * pace:.2g}") for share in _OF_PACE]


def _row(
    system: DelaySystem,
    index: int,
    k1: Sequence[float] | None,
    k2: Sequence[float] | None,
    gain: ArrayLike | None,
    gamma: float | None,
) -> AgeRow:
    """Design, or prove, at one age."""
    age, reason = system.delays[index].d, None
    try:
        loop = design(system, k1, k2, gamma=gamma, gain=gain, alternatives=False)
    except NotAchievableError as error:
        if gain is None:
            return AgeRow(age, None, None, None, None, None, stable=False, reason=error.what)
        loop = analyse(system, gain, gamma if system.has_performance else None)
        reason = loop.reason
    stable = loop.abscissa is not None and loop.abscissa < 0.0
    K = gain_of(system, loop.K)
    return AgeRow(
        age=age,
        K=K,
        gamma=loop.gamma,
        exact_norm=loop.exact_norm,
        control=loop.figures.with_output(_with_control_as_z(system)).exact_norm if stable else None,
        margin=loop.figures.margin_of(index) if stable else None,
        stable=stable,
        reason=reason,
    )


def _with_control_as_z(system: DelaySystem) -> DelaySystem:
    """Return the system with z = u."""
    (n, m), q = system.B.shape, system.C.shape[1]
    return replace(system, D=np.zeros((m, n)), D1=np.zeros((m, q)), D2=np.eye(m))


def _limit(
    system: DelaySystem,
    index: int,
    row: AgeRow,
    gamma: float | None,
    assumption: Assumption,
    least_age: float,
    limit: float,
    known: float,
) -> AgeLimit:
    """Return the greatest certified age of a row's gain under one assumption; from `known` on."""
    at = _at(system, index, row.age, assumption, least_age)
    greatest, done = certified_age(
        *(at, gain_of(at, row.K), gamma),
        delay_index=index,
        limit=limit,
        precision=_PRECISION,
        known=known,
    )
    return AgeLimit(assumption, greatest, done)

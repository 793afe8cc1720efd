"""What could be done in place of a design that is refused: other delays, or another gamma.

Whatever is named was designed and proved by the call that was refused, with nothing else changed.

1. Where a gamma was asked for, the design without it says which gamma can be had; rounded up, it
   is asked for again.
2. The delay of the feedback is shortened (without one: every delay). Its greatest value comes from
   the search for a greatest delay, which solves few problems; rounded down, it is tried in the
   design, and shorter ones where that fails. At last the least one is tried: where that is
   refused too, no delay from there on could be certified.

Everything is bounded by a number of designs, never by time, so that a message is the same on every
machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError, at_least, at_most, report
from cosim.hinf.lmi import FAILED, OTHER_UNITS, without_performance
from cosim.hinf.problem import DesignConstraints, ages_are_known, of_any_age, with_delays
from cosim.hinf.synthesis.analysis import Order, analyse, gain_of
from cosim.hinf.synthesis.certified_delays import certified_age
from cosim.hinf.synthesis.constrained_search import describe_constraints
from cosim.hinf.synthesis.designs import GammaFloorError
from cosim.hinf.synthesis.greatest_delays import greatest_delay
from cosim.hinf.synthesis.ladder import first_proved
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.stabilisability import NoGainError
from cosim.models import DelaySystem

_SHARES = (0.97, 0.8, 0.5)
"""Delays to design for, as shares of the greatest that a search finds."""
_IF_KNOWN = 1.5
"""The same first, where more is known of an age than its bound: the search is for any age."""
_ABOVE = (0.0, 0.01, 0.1)
"""Gammas to ask for, above the least one that was proved without asking for one."""
_BISECTIONS = 3
_LEAST = 1e-3
"""The least delay that is tried [s]; of one below 10 ms a tenth."""
_DELAY_DIGITS, _GAMMA_DIGITS = 2, 4
_PRECISION = 1e-2

DesignAt = Callable[[DelaySystem, float | None, DesignConstraints], Result]
"""The design that was refused, for other delays, another gamma or other constraints."""


@dataclass(frozen=True)
class RefusedDesign:
    """What was asked for.

    Attributes
    ----------
    system, gamma, k1, k2, order, gain : as they were given to `design`.
    constraints : the design constraints.
    design_at : the same design for another system, gamma and constraints.
    """

    system: DelaySystem
    gamma: float | None
    k1: Sequence[float] | None
    k2: Sequence[float] | None
    order: int | Literal["auto"] | None
    gain: ArrayLike | None
    constraints: DesignConstraints
    design_at: DesignAt

    def again(self, system: DelaySystem, gamma: float | None) -> Result:
        """Design with other delays or another gamma, and nothing else changed."""
        return self.design_at(system, gamma, self.constraints)

    @property
    def has_scalars(self) -> bool:
        """Whether the caller chose k1 or k2."""
        return self.k1 is not None or self.k2 is not None


@dataclass(frozen=True)
class Alternatives:
    """What can be certified in place of a refused design.

    Attributes
    ----------
    gamma : that can be had at the delays that were asked for; None: none was found.
    delays : that can be had with what was asked for, all of the system [s].
    together : whether it takes both.
    least : where none can, the delays that were tried last; None otherwise.
    """

    gamma: float | None = None
    delays: tuple[float, ...] | None = None
    together: bool = False
    least: tuple[float, ...] | None = None


def with_alternatives(error: NotAchievableError, refused: RefusedDesign) -> NotAchievableError:
    """Return the error of a refused design in the words of what was asked, with what can be had.

    A cause that no other delay or gamma changes stays as it is.
    """
    if isinstance(error, NoGainError):
        return error
    if isinstance(error, GammaFloorError):
        return _above_the_floor(error, refused)
    can = alternatives_of(refused)
    system, varied = refused.system, varied_delays(refused.system)
    one = refused.order is None and refused.has_scalars  # these k1, k2 were asked for, no others
    gain = "no gain could" if refused.gain is None else "this gain could not"
    got = [str(error.got or error.what)]
    if can.least is not None:
        least = min(can.least[j] for j in varied)
        got.append(f"no {_noun(system)} of {least:g} s or more could be certified either")
    return NotAchievableError(
        error.what if one else f"{gain} be certified{_goal(refused)}{_for_delays(system)}",
        where=system.name or None,
        expected=error.expected if one else None,
        got="; ".join(got),
        hint=_hint(can, refused, error),
        certificate=error.certificate,
        delays=can.delays,
        gamma=can.gamma,
        together=can.together,
    )


def _above_the_floor(error: GammaFloorError, refused: RefusedDesign) -> NotAchievableError:
    """Return the error of a gamma that no controller has, with the least one that can be had."""
    error.gamma = _gamma_to_have(refused)
    if error.gamma is not None:
        have = f"gamma = {error.gamma:g}, which is certified{_for_delays(refused.system)}"
        error.hint = f"{have}, or another D1; no delay and no gain helps"
    return error


def _hint(can: Alternatives, refused: RefusedDesign, error: NotAchievableError) -> str:
    """Return what can be had, else what to change."""
    if can.together and can.delays is not None:
        shorter = described_delays(refused.system, can.delays)
        return f"{shorter} and gamma = {can.gamma:g}, which is certified"
    have = []
    if can.gamma is not None:
        have.append(f"gamma = {can.gamma:g}, which is certified{_for_delays(refused.system)}")
    if can.delays is not None:
        shorter = described_delays(refused.system, can.delays)
        it = "it" if _goal(refused) or refused.gain is not None else "a gain"
        have.append(f"{shorter}, with which {it} is certified")
    return ", or ".join(have or _changes(refused, error))


def _changes(refused: RefusedDesign, error: NotAchievableError) -> list[str]:
    """Return what to change where neither a gamma nor a delay helps."""
    changes = []
    if refused.constraints.any:
        words = describe_constraints(refused.constraints)
        try:
            refused.design_at(refused.system, refused.gamma, DesignConstraints())
        except NotAchievableError:
            changes.append(f"weaker constraints than {words}")
        else:
            changes.append(f"weaker constraints than {words}: without any it is certified")
    if refused.gain is not None:
        changes.append("another gain: a design finds one where there is one")
    if refused.has_scalars:
        changes.append("no k1 and k2, so that they are searched")
    if not changes or FAILED in f"{error.what} {error.got}":
        changes.append(what_else(refused.system))
    return changes


def what_else(system: DelaySystem) -> str:
    """Return what to change of a system that no gamma and no delay helps."""
    return "less uncertainty (E, H)" if system.E.size else OTHER_UNITS


def with_alternatives_to(
    undecided: Result, gamma: float | None, order: Order
) -> NotAchievableError:
    """Return the error of an analysis without a proof, with what can be certified of its gain.

    gamma, order : as they were asked of `analyse`.
    """
    system, K = undecided.system, undecided.K
    gain = K if K.any() else None

    def design_at(there: DelaySystem, bound: float | None, _: DesignConstraints) -> Result:
        analysis = analyse(there, gain, bound, order=order)
        if not analysis.certified:
            raise NotAchievableError(str(analysis.reason))
        return analysis

    refused = RefusedDesign(system, gamma, None, None, order, K, DesignConstraints(), design_at)
    return with_alternatives(NotAchievableError(str(undecided.reason)), refused)


def alternatives_of(refused: RefusedDesign) -> Alternatives:
    """Return what can be certified in place of a design that was refused."""
    gamma = _gamma_to_have(refused)
    varied = varied_delays(refused.system)
    if not varied:
        return Alternatives(gamma)
    report("looking for a delay that can be certified", 0.0)
    delays, least = _delays_to_have(refused, varied)
    if gamma is None and delays is None and refused.gamma is not None:
        both = _both_to_have(refused, varied)
        if both is not None:
            return Alternatives(*both, together=True)
    return Alternatives(gamma, delays, least=least)


def varied_delays(system: DelaySystem) -> list[int]:
    """Return the indices of the delays that are shortened: of the feedback, else all."""
    feedback = [j for j, x in enumerate(system.delays) if x.feedback and x.d > 0]
    return feedback or [j for j, x in enumerate(system.delays) if x.d > 0]


def described_delays(system: DelaySystem, delays: Sequence[float]) -> str:
    """Return delays in words, as those of this system."""
    listed = " and ".join(f"{d:g}" for d in delays)
    if _noun(system) == "age":
        return f"ages up to {listed} s"
    return f"delays of {listed} s" if len(delays) > 1 else f"a delay of {listed} s"


def _noun(system: DelaySystem) -> str:
    return "age" if all(x.any_age or x.sampled for x in system.delays) else "delay"


def _for_delays(system: DelaySystem) -> str:
    delays = [x.d for x in system.delays]
    return f" for {described_delays(system, delays)}" if delays else ""


def _goal(refused: RefusedDesign) -> str:
    goals = [] if refused.gamma is None else [f"gamma = {refused.gamma:g}"]
    goals += [describe_constraints(refused.constraints)] if refused.constraints.any else []
    return f" with {' and '.join(goals)}" if goals else ""


def _both_to_have(
    refused: RefusedDesign, varied: Sequence[int]
) -> tuple[float, tuple[float, ...]] | None:
    """Return a gamma and delays with which a gain is certified; None where none were found."""
    delays, _ = _delays_to_have(replace(refused, gamma=None), varied)
    if delays is None:
        return None
    there = replace(refused, system=with_delays(refused.system, delays))
    gamma = _gamma_to_have(there)
    return None if gamma is None else (gamma, delays)


def _gamma_to_have(refused: RefusedDesign) -> float | None:
    """Return a gamma that is certified when it is asked for; None where none was found."""
    if refused.gamma is None:
        return None
    return gamma_to_have(refused.gamma, lambda gamma: refused.again(refused.system, gamma))


def gamma_to_have(
    asked: float, design_for: Callable[[float | None], Result], above: Sequence[float] = _ABOVE
) -> float | None:
    """Return a gamma above the one that was asked for, certified when it is asked for itself.

    None : none was found.

    design_for : the design for a gamma, or for the least one.
    above : the gammas to ask for, as shares by which they are above the least one.
    """

    def prove(gamma: float) -> tuple[float | None, str]:
        try:
            design_for(gamma)
        except NotAchievableError as error:
            return None, error.what
        return gamma, ""

    try:
        least = design_for(None).gamma
    except NotAchievableError:
        return None
    if least is None:
        return None
    levels = [float(at_most(least * (1 + share), _GAMMA_DIGITS)) for share in above]
    return first_proved([x for x in levels if x > asked], prove)[0]


def _delays_to_have(
    refused: RefusedDesign, varied: Sequence[int]
) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None]:
    """Return delays at which the design is certified; or None and the least that were tried."""
    system = refused.system
    least_share = _least_share(system, varied)

    def at(share: float) -> tuple[float, ...]:
        return tuple(
            float(at_least(share * x.d, _DELAY_DIGITS)) if j in varied else x.d
            for j, x in enumerate(system.delays)
        )

    def prove(share: float) -> tuple[float | None, str]:
        try:
            refused.again(with_delays(system, at(share)), refused.gamma)
        except (NotAchievableError, InputError) as error:  # also a delay below a least age
            return None, error.what
        return share, ""

    greatest = _estimated_share(refused, varied)
    tried = (_IF_KNOWN, *_SHARES) if ages_are_known(system) else _SHARES
    shares = [] if greatest is None else [greatest * x for x in tried]
    share = first_proved([x for x in shares if least_share < x < 1.0], prove)[0]
    if share is not None:
        return at(share), None
    share = prove(least_share)[0]
    if share is None:
        return None, at(least_share)
    if greatest is None:
        share = _bisected(prove, share)
    return at(share), None


def _bisected(prove: Callable[[float], tuple[float | None, str]], share: float) -> float:
    """Return a greater share that is proved, of a few between this one and 1."""
    failed = 1.0
    for _ in range(_BISECTIONS):
        middle = sqrt(share * failed)
        if prove(middle)[0] is None:
            failed = middle
        else:
            share = middle
    return share


def _least_share(system: DelaySystem, varied: Iterable[int]) -> float:
    """Return the share of the delays that is tried last."""
    delays = [system.delays[j] for j in varied]
    longest = max(x.d for x in delays)
    least = min(_LEAST, longest / 10) / longest
    return max(least, *(1.1 * x.least_age / x.d for x in delays), 0.0)


def _estimated_share(refused: RefusedDesign, varied: Sequence[int]) -> float | None:
    """Return about which share of the delay can be certified; None: nothing is known."""
    system, gamma = refused.system, refused.gamma
    if len(varied) > 1 or (refused.gain is None and system.is_structured):
        return None
    index = varied[0]
    limit = system.delays[index].d
    if gamma is None:
        system = without_performance(system)
    if refused.gain is not None:
        K = gain_of(system, refused.gain)
        age, _ = certified_age(
            *(system, K, gamma),
            delay_index=index,
            limit=limit,
            precision=_PRECISION,
            known=None,
        )
        return None if age is None else age / limit
    conditions = [refused.order]
    system = of_any_age(system)  # far fewer problems than with what is known of the ages
    if refused.order == "auto" and system.delays[index].any_age:
        conditions.append(0)  # it follows a gain where the scalars of Theorem 2 end
    greatest = 0.0
    for order in conditions:
        with suppress(NotAchievableError, InputError):
            longest = greatest_delay(
                *(system, gamma, refused.k1, refused.k2),
                delay_index=index,
                limit=limit,
                order=order,
            )
            greatest = max(greatest, longest.delay or 0.0)
    return greatest / limit or None

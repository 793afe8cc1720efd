"""Design as users call it, for every condition and with constraints.

Without design constraints, the routes of `cosim.hinf.synthesis.routes` are tried. With them:

1. The gain of least gamma without the constraints (`cosim.hinf.synthesis.theorem_2_gamma`) is kept
   if they can be proved for it.
2. Otherwise the gain of least gamma that meets them (`cosim.hinf.synthesis.constrained_search`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Literal

from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError
from cosim.hinf.delay_lti import checked_system, one_thread
from cosim.hinf.lmi import without_performance
from cosim.hinf.problem import (
    DesignConstraints,
    ages_are_known,
    design_constraints_of,
    refuse_structure,
    without_uncertainty,
)
from cosim.hinf.synthesis import theorem_2_gamma
from cosim.hinf.synthesis.alternatives import RefusedDesign, with_alternatives
from cosim.hinf.synthesis.analysis import Order, analyse
from cosim.hinf.synthesis.bessel_legendre_gains import bessel_legendre_gains, check_order
from cosim.hinf.synthesis.constrained_search import (
    ConstrainedSearch,
    constrained,
    describe_constraints,
    prove_constraints,
    scalars_of,
    with_guarantees,
)
from cosim.hinf.synthesis.cvxpy_lmi import cvxpy_design
from cosim.hinf.synthesis.damped_gains import damped_design
from cosim.hinf.synthesis.designs import check_achievable, given_gain_design, proved_by_analysis
from cosim.hinf.synthesis.not_achievable import none_succeeded
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.routes import (
    Request,
    analysed_again,
    designed_by_some_route,
    theorem_2_route,
)
from cosim.hinf.synthesis.search import initial_scalars
from cosim.hinf.synthesis.stabilisability import NoGainError
from cosim.hinf.synthesis.structured_gains import structured_design
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem, Matrix


@one_thread
def design(
    system: DelaySystem,
    k1: Sequence[float] | None = None,
    k2: Sequence[float] | None = None,
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool | None = None,
    order: int | Literal["auto"] | None = "auto",
    solver: Literal["clarabel", "cvxpy"] = "clarabel",
    decay: float | None = None,
    damping: float | None = None,
    within: float | None = None,
    gain_limit: float | None = None,
    peak_control: Sequence[float] | float | None = None,
    offset: Sequence[float] | None = None,
    energy: float | None = None,
    alternatives: bool = True,
) -> Result:
    """Design a state feedback and prove its gamma, or prove the gamma of a given gain.

    Parameters
    ----------
    system : Eq. (7) with delays (n states, m inputs).
    k1, k2 : one number per delay, k2 not zero (Theorem 2). Without both, they are searched;
        if one is given, the other is its negative.
    gamma : a bound to meet instead of the least one; the design's own may be lower.
    gain : (m, n) a gain to analyse instead of designing one.
    search : look for better k1, k2 (`cosim.hinf.synthesis.search`), starting from these among
        others. None: where neither is given, or nothing is found at those given; False: never.
    order : "auto" tries every route (`cosim.hinf.synthesis.routes`) and claims the best proof;
        None for Theorem 2 alone; N for the Bessel-Legendre condition of order N, which starts
        from the gain of Theorem 2. Where more is known of an age than its bound, gains of
        Theorem 2 are analysed with these ages, at order 1 unless one is given. With design
        constraints the gain is found by Theorem 2, its gamma proved as said here, and the
        constraints are proved for ages up to their bounds.
    solver : "cvxpy" solves the plain LMI of Theorem 2 with cvxpy and Clarabel.
    decay : alpha [1/s]; with w = 0 every solution decays at least as e^{-alpha t}.
    damping : least damping ratio -Re s / |s|, between 0 and 1, of every characteristic root s of
        the nominal loop (F = 0, each age constant, exactly d) with Re s >= -`within`.
    within : how far to the left roots count [1/s]; no sector holds all of them.
    gain_limit : bound on the largest singular value of K.
    peak_control : bound on every |u_i(t)|, one number or one per input, in the units of u;
        needs `offset`, `energy` or both.
    offset : (n,) the initial state, |x_i| <= offset_i, constant before t = 0.
    energy : int w'w <= energy^2.
    alternatives : where the design is refused, look for a delay and a gamma that can be had, and
        name them in the error, which takes a few times as long; False for a loop of many designs.

    Returns
    -------
    Result
        Its gamma and its `guarantees` are proved, for the whole uncertainty of the system.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no certified solution with this gamma and these design constraints; its
        `delays` and `gamma` are what can be had instead.

    Examples
    --------
    >>> from cosim.hinf import Delay, DelaySystem, design
    >>> pendulum = DelaySystem(
    ...     A=[[0, 1], [1, 0]], B=[[0], [1]], C=[[0], [1]], D=[[1, 0], [0, 0]], D2=[[0], [1]],
    ...     delays=[Delay(0.1, [[0, 0], [0, 0]], feedback=True, any_age=True)],
    ... )
    >>> found = design(pendulum, decay=0.5)
    >>> found.gamma > found.exact_norm, found.abscissa < -0.5, found.K.shape
    (True, True, (1, 2))
    """
    system = checked_system(system, control=True)
    if system.is_structured:
        given_too = (k1, k2, search, decay, peak_control, offset, energy)
        if any(x is not None for x in given_too) or order is None or solver == "cvxpy":
            refuse_structure(
                system, "Theorem 2", "leave out k1, k2, search, solver, decay and peak_control"
            )
    design_constraints = design_constraints_of(
        system,
        decay=decay,
        gain_limit=gain_limit,
        peak_control=peak_control,
        offset=offset,
        energy=energy,
        damping=damping,
        within=within,
    )
    _check_combination(design_constraints, solver)

    def design_at(
        there: DelaySystem, bound: float | None, constraints: DesignConstraints
    ) -> Result:
        return _design(
            *(there, k1, k2, bound, gain, search, order, solver), constraints=constraints
        )

    try:
        return design_at(system, gamma, design_constraints)
    except NotAchievableError as error:
        if not alternatives:
            raise
        refused = RefusedDesign(system, gamma, k1, k2, order, gain, design_constraints, design_at)
        raise with_alternatives(error, refused) from None


def _design(
    system: DelaySystem,
    k1: Sequence[float] | None,
    k2: Sequence[float] | None,
    gamma: float | None,
    gain: ArrayLike | None,
    search: bool | None,  # noqa: FBT001 - passed on as it was given
    order: Order | None,
    solver: str,
    *,
    constraints: DesignConstraints,
) -> Result:
    """Design or prove a gain, as `design` does, or refuse it."""
    given = k1 is not None or k2 is not None
    one, two, look = initial_scalars(system, k1, k2, search)
    if gamma is not None:
        check_achievable(gamma, system)
    if system.is_structured:
        return structured_design(system, order, gamma, gain, constraints)
    if isinstance(order, int):
        check_order(order, system)
    asked = Request(system, one, two, given, look or search, gamma)
    if not constraints.any:
        if gain is None:
            return _designed(asked, order, solver, search=look)
        return _proved(asked, gain, order, solver, search=look)
    return _with_constraints(asked, gain, constraints, order, search=look, given=search)


def _with_constraints(
    asked: Request,
    gain: ArrayLike | None,
    design_constraints: DesignConstraints,
    order: Order | None,
    *,
    search: bool,
    given: bool | None,
) -> Result:
    """Design or prove a gain with design constraints; `given`: what was asked of the search."""
    theorem_2_gamma.checked_scalars(asked.system, asked.k1, asked.k2)

    def proved(K: ArrayLike) -> Result:
        return _proved_with_constraints(asked, K, design_constraints, order, search=search)

    def undamped(constraints: DesignConstraints) -> Result:
        if not constraints.any:
            return _designed(asked, order, "clarabel", search=search)
        return _constrained(asked, constraints, order, search=search, may_search=given is None)

    if gain is not None:
        return proved(gain)
    damping = design_constraints.damping_to_prove
    if damping is None:
        return undamped(design_constraints)
    return damped_design(asked.system, design_constraints, damping, undamped, proved)


def _sharpest(designed: Result, gamma: float | None, order: Order | None) -> Result:
    """Return a design of Theorem 2 with constraints, its gamma proved by the condition asked for.

    Raises
    ------
    NotAchievableError : an order is asked for, and its condition does not prove the gain.
    """
    if designed.order is not None or order is None:
        return designed
    if isinstance(order, int):
        again = given_gain_design(designed.system, designed.K, gamma, order)
    elif gamma is not None and not ages_are_known(designed.system):
        return designed
    else:
        again = analysed_again(designed)
    return again if again is designed else with_guarantees(again, designed.guarantees)


def _designed(asked: Request, order: Order | None, solver: str, *, search: bool) -> Result:
    """Design a gain without design constraints."""
    system, one, two, gamma = asked.system, asked.k1, asked.k2, asked.gamma
    if solver == "cvxpy":
        return cvxpy_design(system, one, two, gamma=gamma, search=search)
    if ages_are_known(system):
        return designed_by_some_route(asked, order if isinstance(order, int) else "auto")
    theorem_2_gamma.checked_scalars(system, one, two)
    if order == "auto":
        return designed_by_some_route(asked)
    if order is None:
        return theorem_2_gamma.design(system, one, two, gamma=gamma, search=search)
    starts = []
    with suppress(NotAchievableError):  # there are other starts as well
        starts = [theorem_2_gamma.design(system, one, two, search=search).K]
    gains = bessel_legendre_gains(system, order, starts, gamma)
    return proved_by_analysis(system, gains, gamma, order)


def _proved(
    asked: Request, gain: ArrayLike, order: Order | None, solver: str, *, search: bool
) -> Result:
    """Prove a given gain without design constraints."""
    system, one, two, gamma = asked.system, asked.k1, asked.k2, asked.gamma
    if solver == "cvxpy":
        return cvxpy_design(system, one, two, gamma=gamma, gain=gain, search=search)
    if ages_are_known(system):
        of_analysis: Order = order if isinstance(order, int) else "auto"
        return given_gain_design(system, gain, gamma, of_analysis)
    if order is not None:
        try:
            return given_gain_design(system, gain, gamma, order)
        except NotAchievableError:
            if order != "auto":
                raise
    return theorem_2_gamma.design(system, one, two, gamma=gamma, gain=gain, search=search)


def _check_combination(design_constraints: DesignConstraints, solver: str) -> None:
    """Refuse design constraints with another solver than their own."""
    if design_constraints.any and solver == "cvxpy":
        raise InputError(
            "the plain LMI in cvxpy is without design constraints",
            where="solver",
            expected=f"no other solver, with {describe_constraints(design_constraints)}",
            got=solver,
        )


def _constrained(
    asked: Request,
    design_constraints: DesignConstraints,
    order: Order | None,
    *,
    search: bool,
    may_search: bool,
) -> Result:
    """Design with constraints by Theorem 2, the gamma of its gain proved as it is asked for."""
    plain: Result | None = None
    # without a constraint the best gain may be unbounded
    with suppress(NotAchievableError):
        plain = theorem_2_gamma.design(
            asked.system, asked.k1, asked.k2, gamma=asked.gamma, search=search
        )
    designed = _by_theorem_2(
        asked, plain, design_constraints, order, search=search, may_search=may_search
    )
    return _sharpest(designed, asked.gamma, order)


def _by_theorem_2(
    asked: Request,
    plain: Result | None,
    design_constraints: DesignConstraints,
    order: Order | None,
    *,
    search: bool,
    may_search: bool,
) -> Result:
    """Return the design that meets the constraints: `plain`, or another from k1, k2."""
    system, gamma = asked.system, asked.gamma
    start = theorem_2_gamma.checked_scalars(system, asked.k1, asked.k2)
    if plain is not None:
        start = scalars_of(plain)
        guarantees, _ = prove_constraints(plain, design_constraints, start)
        if guarantees is not None:
            return with_guarantees(plain, guarantees)
    errors: list[tuple[str, NotAchievableError]] = []
    for look in (search, True) if may_search and not search else (search,):
        searching = ConstrainedSearch(start, system, design_constraints, gamma, search=look)
        try:
            return searching.best(plain)
        except NotAchievableError as error:
            errors.append((theorem_2_route(asked, searched=look), error))
    if may_search:
        for name, propose in _other_gains(asked, start, design_constraints):
            try:
                return _proved_with_constraints(
                    asked, propose(), design_constraints, order, search=True
                )
            except NotAchievableError as error:
                if isinstance(error, NoGainError):
                    break
                errors.append((name, error))
    raise none_succeeded(errors)


def _other_gains(
    asked: Request, start: Scalars, design_constraints: DesignConstraints
) -> Iterator[tuple[str, Callable[[], Matrix]]]:
    """Yield ways to a gain that may meet the constraints, each with its name."""
    if asked.system.has_performance and design_constraints.energy is None:
        bare = without_performance(asked.system)
        searching = ConstrainedSearch(start, bare, design_constraints, None, search=True)
        yield "the constraints for stability, then its gain", lambda: searching.best(None).K
    yield "a gain without the constraints", lambda: designed_by_some_route(asked).K


def _proved_with_constraints(
    asked: Request,
    gain: ArrayLike,
    design_constraints: DesignConstraints,
    order: Order | None,
    *,
    search: bool,
) -> Result:
    """Prove a given gain with the constraints."""
    system = asked.system
    proved = _proved(asked, gain, order, "clarabel", search=search)
    at = theorem_2_gamma.checked_scalars(system, asked.k1, asked.k2)
    at = at if proved.order is not None else scalars_of(proved)
    return constrained(proved, design_constraints, at)


def nominal_gamma(proved: Result) -> float | None:
    """Return the least certified gamma of the same K, k1, k2 or order, without uncertainty.

    Its distance to `proved.gamma` is the cost of E, H, its distance to the exact norm the
    conservatism of the condition. Takes about as long as half a design.

    Returns
    -------
    None where only stability is certified; `proved.gamma` where nothing is uncertain.

    Raises
    ------
    NotAchievableError : no proof was found.
    """
    if proved.gamma is None or not proved.system.E.size:
        return proved.gamma
    nominal = without_uncertainty(proved.system)
    if proved.order is not None:
        return analyse(nominal, proved.K, order=proved.order).gamma
    return theorem_2_gamma.design(nominal, proved.k1, proved.k2, gain=proved.K).gamma

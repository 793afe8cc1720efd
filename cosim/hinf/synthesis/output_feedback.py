"""Design an observer and the gain that acts on its estimate, together, and prove their pair.

1. L starts from the LMI of the error (`injection_lmi`), K from a linear-quadratic regulator.
2. A descent on the gain of the pair, uncertainty included (`pair_gain`), improves both together,
   at constant ages: at the greatest, then at somewhat longer ones, which are more cautious. Where
   commands are late, first as if they acted at once: a step of age costs those gains little, and
   a descent that knows of it ends elsewhere, often with a worse proof.
3. The pair of each, K and L rounded, is analysed with the ages as they are, and the best is kept.

Only the analysis is a proof (`cosim.hinf.certificate.pair_of`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, NotAchievableError, report
from cosim.hinf.certificate import (
    MAX_OFFSETS,
    Guarantees,
    ObserverPair,
    check_peaks_asked,
    output_feedback_to_json,
    pair_of,
    too_many_offsets,
)
from cosim.hinf.delay_lti import (
    NominalFigures,
    checked_system,
    nominal_figures_of,
    one_thread,
)
from cosim.hinf.lmi import InjectionLmi, Scaling, proved_state_peaks, solver_words, units_of
from cosim.hinf.problem import ages_are_known
from cosim.hinf.synthesis.analysis import (
    Order,
    best_analysis,
    check_gamma,
    check_order_of_analysis,
)
from cosim.hinf.synthesis.conditions import is_large
from cosim.hinf.synthesis.descent import Descent
from cosim.hinf.synthesis.designs import rounded_gain
from cosim.hinf.synthesis.pair_gain import PairGain, parts_of_plant
from cosim.hinf.synthesis.result import Result, proved_facts
from cosim.hinf.synthesis.younger_measurements import name_younger
from cosim.models import DelaySystem, Matrix, Measurement

_LONGER = (1.0, 1.1, 1.2, 1.4)
"""Ages for which K and L are proposed, as multiples of those that vary; the longest for pairs
whose proof is far from their loop, of which the first above it that is proved is the best."""
_ENOUGH = 2
"""Proposals after which no more are made where one is certified."""
_MULTIPLIERS = (0.3, 1.0, 3.0)
"""b of `InjectionLmi`, as multiples of the greatest age."""
_POOR = 4.0
"""Gamma over the pair's norm above which proofs that take longer are tried as well."""
_NEAR = 1.3
"""Share of the pair's norm: with a gamma below it longer ages are not tried, which cost as much."""
_BITS = 20  # of the entries of L, relative to the largest of its column
_EVALUATIONS = 250
_SMALL = 1e-3  # weight of states and controls that are not in z, in own units
_CHEAPER = (1.0, 0.1, 0.01, 0.001)
"""Weights of u of the regulators, as shares of that in z."""
_TRIED = 4
"""Starts that are improved in turn where none bears what is uncertain."""
_RATE = 0.5  # of an injection into what is measured, times its age
_AGELESS = 1e-2  # s per unit of time: the age that stands for none


Start = tuple[Matrix, Sequence[Matrix]] | None
"""K (m, n) and every L (n, k_i) to begin with."""


class TooUncertainError(NotAchievableError):
    """No observer and gain were found that bear the uncertainty of a plant.

    Attributes
    ----------
    gain : least gain round F that was met, scaled as in the proof; it must be less than 1. It is
        about proportional to the uncertainty.
    start : K and every L that have it.
    """

    def __init__(self, what: str, gain: float = np.inf, start: Start = None, **parts: Any) -> None:
        self.gain, self.start = gain, start
        parts.setdefault("expected", "a gain round F, scaled as in the proof, of less than 1")
        parts.setdefault("got", f"{gain:.3g} at best")
        super().__init__(what, **parts)


@one_thread
def design_output_feedback(
    system: DelaySystem,
    measurements: Sequence[Measurement],
    *,
    gain: ArrayLike | None = None,
    injections: Sequence[ArrayLike] | None = None,
    start: Start = None,
    gamma: float | None = None,
    command_age: float = 0.0,
    command_any_age: bool = False,
    estimated: Sequence[bool] | None = None,
    order: Order = "auto",
    quick: bool = False,
    offset: Sequence[float] | None = None,
    initial_error: Sequence[float] | None = None,
    energy: float = 0.0,
) -> Result:
    """Design K and L for measurements with ages of their own, or prove given ones.

    Parameters
    ----------
    system : the plant, Eq. (7) (n states, m controls), without feedback of its own.
    measurements : what the observer receives.
    gain : (m, n) a K to keep; None: it is designed.
    injections : one L (n, k_i) per measurement to keep; None: they are designed.
    start : K and every L to try first as a start of the search, such as those of a
        `TooUncertainError` for more uncertainty.
    gamma : a bound to meet instead of the least one.
    command_age : age [s] at which u acts, constant (play-out); 0: at once.
    command_any_age : any age up to it, in place of the constant one.
    estimated : one truth value per state; False: it is known (`ObserverPair`). None: all are
        estimated.
    order : of the analysis, as of `analyse`.
    quick : without a proved bound of the nominal norm and delay margins, which take seconds, of a
        pair of many states without proofs that take half a minute, and where it is refused
        without a search for younger measurements that can be certified.
    offset : (n,) also prove peaks of u and x from |x_i| <= offset_i, constant before t = 0.
    initial_error : (n,) |x_i - xh_i| <= initial_error_i there, whatever x is; None: the estimate
        starts at zero, so that the error is x.
    energy : of the disturbance of these peaks, int w'w <= energy^2, noise included.

    Raises
    ------
    InputError : numbers that do not fit the system.
    TooUncertainError : no K and L were found that bear what is uncertain at constant ages.
    NotAchievableError : no K and L were found whose pair is certified, or no proof of the peaks.

    Examples
    --------
    >>> from cosim.hinf import DelaySystem, design_output_feedback
    >>> from cosim.models import Measurement
    >>> slow = DelaySystem(A=[[-0.1]], B=[[1]], C=[[1]], D=[[1], [0]], D2=[[0], [1]])
    >>> late = Measurement("depth", [[1]], 0.5, any_age=True, noise=[0.1])
    >>> found = design_output_feedback(slow, [late])
    >>> bool(found.gamma < 1.1 * found.exact_norm), found.K.shape, found.L[0].shape
    (True, (1, 1), (1, 1))
    """
    system = checked_system(system, control=True)
    check_order_of_analysis(order)

    def design_with(used: Sequence[Measurement], age: float, bound: float | None) -> Result:
        known = {
            "command_age": age,
            "command_any_age": command_any_age,
            "estimated": estimated,
        }
        at_rest = None if offset is None else (offset, initial_error, energy)
        return _designed(
            *(system, used, gain, injections, start, bound, known, order, at_rest), quick=quick
        )

    try:
        return design_with(measurements, command_age, gamma)
    except NotAchievableError as error:
        if not quick:
            name_younger(error, measurements, command_age, gamma, design_with)
        raise


def _designed(
    system: DelaySystem,
    measurements: Sequence[Measurement],
    gain: ArrayLike | None,
    injections: Sequence[ArrayLike] | None,
    start: Start,
    gamma: float | None,
    known: dict[str, Any],
    order: Order,
    at_rest: tuple[Sequence[float], Sequence[float] | None, float] | None,
    *,
    quick: bool,
) -> Result:
    """Design or prove an output feedback, as `design_output_feedback` does, or refuse it.

    at_rest : offset, initial error and energy, of which peaks are proved; None: none are.
    """
    (n, m) = system.B.shape
    K = np.zeros((m, n)) if gain is None else gain
    L = [np.zeros(x.C.T.shape) for x in measurements] if injections is None else injections
    given = pair_of(system, measurements, K, L, **known)
    if gamma is not None:
        check_gamma(gamma, given.system)
    starts = None if at_rest is None else _starts(given, *at_rest[:2])
    proposed = iter([(given.K, list(given.L))])
    if gain is None or injections is None:
        kept = None if gain is None else given.K
        L_kept = None if injections is None else list(given.L)
        proposed = _proposals(given, known, kept, L_kept, start)
    designed = _best(system, measurements, proposed, known, gamma, order, brief=quick)
    if starts is None or at_rest is None:
        return designed
    return _with_peaks(designed, starts, at_rest[2])


def _starts(
    pair: ObserverPair, offset: Sequence[float], initial_error: Sequence[float] | None
) -> Matrix:
    """Return the columns of initial states (x, e), each with one offset."""
    n, sizes = len(pair.estimated), []
    for name, values in (("offset", offset), ("initial_error", initial_error or ())):
        numbers = np.array([float(x) for x in values])
        fits = len(numbers) == n or (name == "initial_error" and initial_error is None)
        if not (fits and np.isfinite(numbers).all() and (numbers >= 0).all()):
            raise InputError(
                "not the size of an initial state",
                where=name,
                expected=f"{n} numbers >= 0, one per state",
                got=str(list(values)),
            )
        sizes.append(numbers)
    x, e = np.diag(sizes[0]), np.diag(sizes[0])[pair.estimated]
    if initial_error is not None:
        error = np.diag(sizes[1])[pair.estimated]
        x, e = np.hstack([x, np.zeros((n, n))]), np.hstack([np.zeros_like(e), error])
    columns = np.vstack([x, e])
    columns = columns[:, columns.any(axis=0)]
    if columns.shape[1] > MAX_OFFSETS:
        raise too_many_offsets(columns.shape[1], "offset")
    return np.asarray(columns)


def _with_peaks(designed: Result, starts: Matrix, energy: float) -> Result:
    """Return an output feedback with proved peaks of u and x."""
    pair, N = designed.pair, len(designed.pair.system.A)
    (n, m) = pair.plant.B.shape
    rows = np.vstack([pair.gain[:m], np.eye(N)[:n]])
    check_peaks_asked(rows, starts, N, "offset")
    if not (np.isfinite(energy) and energy >= 0):
        raise InputError("not an energy", where="energy", expected=">= 0", got=repr(energy))
    peaks = proved_state_peaks(pair.system, pair.gain, rows, starts, energy)
    if peaks is None:
        raise NotAchievableError(
            "no peaks of the controls and the state could be proved",
            where=pair.plant.name or None,
            expected="a functional of order 0",
            hint="younger measurements; a design without offset",
        )
    more = Guarantees(state_peaks=peaks)
    certificate = output_feedback_to_json(pair, more.beside(designed.certificate["pair"]))
    return replace(designed, certificate=certificate, guarantees=more)


def _best(
    system: DelaySystem,
    measurements: Sequence[Measurement],
    proposed: Iterator[tuple[Matrix, list[Matrix]]],
    known: dict[str, Any],
    gamma: float | None,
    order: Order,
    *,
    brief: bool,
) -> Result:
    """Return the best proof of the gains that are proposed, until they become worse."""
    made: list[tuple[ObserverPair, Result]] = []
    tried: list[tuple[ObserverPair, NominalFigures]] = []
    reason = "no gains were found that stabilise it"
    with solver_words():
        for count, (K, L) in enumerate(proposed, 1):
            pair = pair_of(system, measurements, K, L, **known)
            figures = nominal_figures_of(pair.system, pair.gain)
            quick = best_analysis(*(pair.system, pair.gain, gamma, order, figures), ranking=True)
            if figures.abscissa is not None and figures.abscissa < 0:
                tried.append((pair, figures))
            if quick.certificate is None:
                reason = quick.reason or reason
                continue
            worse = bool(made) and (quick.gamma or 0.0) >= (made[-1][1].gamma or 0.0)
            made.append((pair, quick))
            near = quick.gamma is not None and quick.gamma <= _NEAR * (quick.exact_norm or 0.0)
            if worse or near or quick.gamma is None or gamma is not None or count >= _ENOUGH:
                break
        if order == "auto":
            made += _by_all_conditions(made, tried, gamma)
    if not made:
        raise NotAchievableError(
            "no observer and gain could be certified",
            where=system.name or None,
            expected="an exact proof of stability" if gamma is None else f"gamma = {gamma:g}",
            got=reason,
            hint="younger measurements, less uncertainty, "
            + ("" if gamma is None else "a larger gamma, ")
            + "or gains of your own",
        )
    pair, analysis = min(made, key=lambda one: one[1].gamma or 0.0)
    large = not brief and is_large(pair.system, pair.gain)
    if order == "auto" and (large or ages_are_known(pair.system)):  # ranking tried what is quick
        full = best_analysis(pair.system, pair.gain, gamma, order, analysis.figures)
        analysis = min(
            (analysis, full), key=lambda one: (one.certificate is None, one.gamma or 0.0)
        )
    return _certified(pair, analysis)


def _by_all_conditions(
    made: Sequence[tuple[ObserverPair, Result]],
    tried: Sequence[tuple[ObserverPair, NominalFigures]],
    gamma: float | None,
) -> list[tuple[ObserverPair, Result]]:
    """Return proofs of the first gains, until one is good, by conditions too slow for all.

    Nothing where the quick ones did well, and for pairs of few states, whose conditions are all
    quick.
    """
    more: list[tuple[ObserverPair, Result]] = []
    for pair, figures in tried[:_ENOUGH]:
        proved = [one for _, one in (*made, *more)]
        if any((one.gamma or 0.0) <= _POOR * (one.exact_norm or np.inf) for one in proved):
            break
        if is_large(pair.system, pair.gain):
            analysis = best_analysis(pair.system, pair.gain, gamma, 0, figures)
            more += [(pair, analysis)] if analysis.certificate is not None else []
    return more


def _certified(pair: ObserverPair, analysis: Result) -> Result:
    """Return the output feedback of a certified analysis of its pair."""
    if analysis.certificate is None:
        raise ValueError("expected a certified analysis")
    certificate = output_feedback_to_json(pair, analysis.certificate)
    facts = proved_facts(certificate)
    return Result(
        **facts,
        figures=analysis.figures,
        certificate=certificate,
        least_gamma=analysis.least_gamma,
    )


def _proposals(
    given: ObserverPair,
    known: dict[str, Any],
    K: Matrix | None,
    L: list[Matrix] | None,
    start: Start,
) -> Iterator[tuple[Matrix, list[Matrix]]]:
    """Yield K and L, of the best gain first at the ages themselves, then at longer ones.

    Where commands are late, first those of commands at once.

    Raises
    ------
    TooUncertainError : none was found that bears what is uncertain.
    """
    plant = given.plant
    units = _units(plant, given.estimated)
    starts_K = _regulators(plant, units) if K is None else [np.zeros_like(K)]
    starts_L = _injections(given, units) if L is None else [[np.zeros_like(x) for x in L]]
    output = [np.abs(x.C) @ units.state for x in given.measurements]
    per_K = units.input[:, None] / units.state
    per_L = [units.state[:, None] / units.T / size for size in output]
    theta: Matrix | None = None
    before, too_quick = np.inf, False
    as_it_is = PairGain(plant, given.measurements, known, K=K, L=L)
    for factor, age in _stages(given):
        if too_quick and age == 0.0:
            continue
        report(f"observer and gain for ages {factor:g} times as long", 0.0)
        longer = [replace(x, d=factor * x.d) if x.any_age else x for x in given.measurements]
        acting = known | {"command_age": age}
        loop = PairGain(plant, longer, acting, K=K, L=L)
        alone = PairGain(plant, longer, acting, K=K, L=L, only_uncertain=True)
        uncertain = alone if plant.E.size else None
        descent = Descent(loop, uncertain, loop.theta(per_K, per_L), 1 / units.T, _EVALUATIONS)
        starts = [theta] if theta is not None else []
        if theta is None or age > before == 0.0:  # what was found may not be stable at this age
            pairs = [*([start] if start else []), *itertools.product(starts_K, starts_L)]
            others = [loop.theta(*x) * loop.free for x in pairs]
            starts += _in_turn(others, alone) if plant.E.size else others[:1]
        before = age
        better = next((x for x in map(descent.from_start, starts) if x is not None), None)
        if better is None and theta is None and np.isfinite(descent.least_alone):
            raise TooUncertainError(
                "no observer and gain were found that bear what is uncertain",
                float(np.exp(descent.least_alone)),
                None if descent.nearest is None else loop.gains(descent.nearest),
                where=plant.name or None,
                hint="less uncertainty, younger measurements",
            )
        if better is None:
            continue
        theta = better
        # commands as late as they are may be more than gains for commands at once bear
        too_quick = age == 0.0 < given.command_age and as_it_is.abscissa(better).value >= 0
        gains = loop.gains(better)
        rounded = rounded_gain(gains[0], units) if K is None else K
        yield rounded, [_short(x) for x in gains[1]] if L is None else L


def _stages(given: ObserverPair) -> Iterator[tuple[float, float]]:
    """Yield by how much ages that vary are made longer, and the age of the command [s]."""
    age, varies = given.command_age, given.command_any_age and given.command_age > 0
    if varies:
        longer = any(x.any_age for x in given.measurements)
        yield from ((factor, 0.0) for factor in (_LONGER if longer else _LONGER[:1]))
    any_age = any(x.any_age for x in given.system.delays)
    for factor in _LONGER if any_age else _LONGER[:1]:
        yield factor, factor * age if varies else age


def _in_turn(starts: Sequence[Matrix], alone: PairGain) -> list[Matrix]:
    """Return the first start that bears what is uncertain; without one, the quickest ones.

    What they bear at the start does not tell which can be improved: high gains can.
    """
    for theta in starts:
        value = alone.gain(theta).value
        if np.isfinite(value):
            value = min(value, alone.gain(theta, alone.balanced(theta)).value)
        if value < 0:
            return [theta]
    return list(reversed(starts))[:_TRIED]


def _units(plant: DelaySystem, estimated: NDArray[np.bool_]) -> Scaling:
    """Return units in which K and L compare: those of the plant without the states that are known.

    Lags of actuators are quick, and would give the time in which a thruster moves. The units of
    known states are those that the inputs give them at rest.
    """
    slow, known = np.flatnonzero(estimated), np.flatnonzero(~estimated)
    if not known.size or not slow.size:
        return units_of(plant)[0]
    inner = plant.A[np.ix_(known, known)]
    if not np.linalg.eigvals(inner).real.max() < 0:
        return units_of(plant)[0]
    at_rest = -np.linalg.solve(inner, np.hstack([plant.A[np.ix_(known, slow)], plant.B[known]]))
    through = plant.A[np.ix_(slow, known)] @ at_rest
    count = slow.size
    reduced = _restricted(
        plant,
        slow,
        A=plant.A[np.ix_(slow, slow)] + through[:, :count],
        B=plant.B[slow] + through[:, count:],
    )
    scaling = units_of(reduced)[0]
    state = np.ones(len(plant.A))
    state[slow] = scaling.state
    state[known] = np.abs(at_rest) @ np.concatenate([scaling.state, scaling.input])
    return replace(scaling, state=np.where(state > 0, state, 1.0))


def _short(L: Matrix) -> Matrix:
    """Round to so few bits that products with the noise are exact: 20 of each column's largest."""
    largest = np.abs(L).max(axis=0)
    step = np.exp2(np.floor(np.log2(np.where(largest > 0, largest, 1.0))) - _BITS)
    return np.asarray(np.round(L / step) * step + 0.0)


def _regulators(plant: DelaySystem, units: Scaling) -> list[Matrix]:
    """Return gains (m, n) of linear-quadratic regulators without delays; zero without one.

    The first weighs u as z does, further ones less. What is uncertain of a state's own rate is
    taken at its least damping.
    """
    scaled = units.system(plant)
    A = scaled.A + sum((x.A for x in scaled.delays), np.zeros_like(scaled.A))
    A = A + np.diag(np.diagonal(np.abs(scaled.E) @ np.abs(scaled.H))) if scaled.blocks else A
    (n, m) = scaled.B.shape
    gains = []
    for share in _CHEAPER:
        Q = scaled.D.T @ scaled.D + _SMALL * np.eye(n)
        R = share * scaled.D2.T @ scaled.D2 + _SMALL * np.eye(m)
        try:
            P = scipy.linalg.solve_continuous_are(A, scaled.B, Q, R)
        except (ValueError, np.linalg.LinAlgError):
            continue
        in_units = -np.linalg.solve(R, scaled.B.T @ P)
        gains.append(np.asarray(in_units * units.input[:, None] / units.state))
    return gains or [np.zeros((m, n))]


def _injections(given: ObserverPair, units: Scaling) -> list[list[Matrix]]:
    """Return the injections of the error's LMI at the best of some multipliers, if there are any.

    After them those that correct what is measured at a rate of 0.5 / age, and nothing else: the
    LMI leaves open what the error of another state hides.
    """
    best = [np.zeros(x.C.T.shape) for x in given.measurements]
    solved = True
    for states in parts_of_plant(given.plant, given.measurements):
        seen = [i for i, x in enumerate(given.measurements) if x.C[:, states].any()]
        if not (given.estimated[states].any() and seen):
            continue
        rows = [np.asarray(given.measurements[i].C[:, states].any(axis=1)) for i in seen]
        injections = _injections_of_part(given, units, states, list(zip(seen, rows, strict=True)))
        solved = solved and injections is not None
        for i, chosen, L in zip(seen, rows, injections or (), strict=False):
            best[i][np.ix_(states, chosen)] = L
    alone = [x.C.T * (_RATE / (x.d or _AGELESS * units.T)) for x in given.measurements]
    return ([best] if solved else []) + [alone]


def _injections_of_part(
    given: ObserverPair,
    units: Scaling,
    states: NDArray[np.bool_],
    measured: Sequence[tuple[int, NDArray[np.bool_]]],
) -> list[Matrix] | None:
    """Return the injections (states of a part, rows that measure it) of the LMI; None without."""
    measurements = [
        replace(x, C=x.C[rows][:, states], noise=np.array(x.noise)[rows].tolist())
        for x, rows in ((given.measurements[i], rows) for i, rows in measured)
    ]
    longest = max(x.d for x in measurements) or _AGELESS * units.T
    lmi = InjectionLmi(
        *(_restricted(given.plant, states), measurements, given.estimated[states]),
        *(units.state[states], units.T),
    )
    solutions = [lmi.least_gamma(b * longest) for b in _MULTIPLIERS]
    best = min((x for x in solutions if x is not None), key=lambda x: x[0], default=None)
    return None if best is None else best[1]


def _restricted(plant: DelaySystem, states: NDArray[Any], **changed: Any) -> DelaySystem:
    """Return a plant with some of its states alone."""
    inner = np.ix_(states, states)
    changed = {"A": plant.A[inner], "B": plant.B[states]} | changed
    return replace(
        plant,
        C=plant.C[states],
        D=plant.D[:, states],
        E=plant.E[states],
        H=plant.H[:, states],
        delays=tuple(replace(x, A=x.A[inner], H=x.H[:, states]) for x in plant.delays),
        feedback=None,
        **changed,
    )

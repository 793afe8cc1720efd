"""A design and what it is to meet beside gamma: the door that users come in by.

1. The gain of least gamma, without the demands (`cosim.hinf.synthesis`). Where they are proved
   of it as it is, it stays.
2. Else the LMI with everything in it (`cosim.hinf.limited`). Its shared X makes it meet more
   than is asked, so the demands are then relaxed on the way back to the first design, as far
   as they can still be proved: each step is a design with its own proofs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.errors import NotAchievableError
from cosim.hinf import synthesis
from cosim.hinf.assembly import Scalars
from cosim.hinf.conic import Solution
from cosim.hinf.control_limits import GainLimit, norm_above, offset_corners
from cosim.hinf.decay_lmi import corner_scalars, proved_decay
from cosim.hinf.demands import Demands, demands_of
from cosim.hinf.from_control import checked_system
from cosim.hinf.guarantees import Guarantees
from cosim.hinf.limited import LimitedProblem
from cosim.hinf.peak_lmi import THETAS, proved_peak_control
from cosim.hinf.problem import Answer, Problem
from cosim.hinf.rational import exact
from cosim.hinf.search import least_gamma, starting, starts
from cosim.hinf.synthesis import Design, checked_scalars
from cosim.hinf.threads import one_thread
from cosim.models.delay_system import DelaySystem

_SLACK = 1e-3
"""Share by which the solver is to stay inside what is demanded: K is rounded after it."""
_STARTS = 4
"""How many k1, k2 are tried for the demands in full."""
_NEARLY = 0.85
"""Strength tried first where nothing says which."""
_STEPS = 2
"""Designs on the way back from there."""
_COARSE = tuple(math.log(4.0) * k for k in range(-1, 4))
_FINE = (math.log(2.0), math.log(1.4), math.log(1.2))
"""Levels of V: logarithms beside the natural one that are tried, and steps to refine the best."""


def design(
    system: DelaySystem,
    k1: Sequence[float] | None = None,
    k2: Sequence[float] | None = None,
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool | None = None,
    decay: float | None = None,
    gain_limit: float | None = None,
    peak_control: Sequence[float] | float | None = None,
    offset: Sequence[float] | None = None,
    energy: float | None = None,
) -> Design:
    """The gain of least gamma, or of a given gamma, or the least gamma of a given gain.

    Parameters
    ----------
    system : Eq. (7) with delays (n states, m inputs).
    k1, k2 : one number per delay, k2 not zero (Theorem 2). Without both, they are searched;
        one alone makes the other, k1 = -k2.
    gamma : a bound to be met instead of the least one; the design's own may be lower.
    gain : (m, n) a gain to be analysed instead of designed.
    search : look for better k1, k2 (`cosim.hinf.search`), starting from these among others.
    decay : alpha [1/s]; with w = 0 every solution is to fall at least as e^{-alpha t}.
    gain_limit : bound on the largest singular value of K.
    peak_control : bound on every |u_i(t)|, one number or one per input, in the units of u,
        from `offset` and `energy`, at least one of which is to be given:
    offset : (n,) the initial state, |x_i| <= offset_i, held before t = 0.
    energy : int w'w <= energy^2.

    Returns
    -------
    Design
        Its gamma and its `guarantees` are proved, with everything uncertain in the system.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no certified solution at k1, k2, with gamma and what is demanded.

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
    system = checked_system(system)
    one, two, look = starting(system, k1, k2, search)
    demands = demands_of(
        system,
        decay=decay,
        gain_limit=gain_limit,
        peak_control=peak_control,
        offset=offset,
        energy=energy,
    )
    plain: Design | None = None
    try:
        plain = synthesis.design(system, one, two, gamma=gamma, gain=gain, search=look)
    except NotAchievableError:
        # a gain without bound may be the best there is, where no limit is set to it
        if not demands.any or gain is not None:
            raise
    if plain is None:
        return _Limited(
            checked_scalars(system, one, two), system, demands, gamma, search=look
        ).best()
    if not demands.any:
        return plain
    guarantees, reason = _proved(plain, demands)
    if guarantees is not None:
        return _with(plain, guarantees)
    if gain is not None:
        raise NotAchievableError(
            "what is demanded of this gain could not be proved",
            where=system.name or None,
            expected=_words(demands),
            got=reason,
        )
    search_for = _Limited(_scalars(plain), system, demands, gamma, search=look)
    return search_for.best(plain)


@one_thread
def _proved(found: Design, demands: Demands) -> tuple[Guarantees | None, str]:
    """Proofs of everything demanded, for the gain as it is; or None and why."""
    system, K = found.system, found.K
    scalars = starts(_scalars(found))
    made: dict[str, Any] = {}
    if demands.gain_limit is not None:
        limit = GainLimit(exact(min(norm_above(K), demands.gain_limit)))
        if limit.failure(system, K) is not None:
            return None, f"gain_limit: the norm of K is {norm_above(K):.6g}"
        made["gain_limit"] = limit
    if demands.peak_control is not None:
        peak, reason = proved_peak_control(system, K, demands, scalars)
        if peak is None:
            return None, f"peak_control: {reason}"
        made["peak_control"] = peak
    if demands.decay is not None:
        decay, reason = proved_decay(system, K, demands.decay, scalars[0])
        if decay is None:
            return None, f"decay: {reason}"
        made["decay"] = decay
    return Guarantees(**made), ""


def _with(found: Design, guarantees: Guarantees) -> Design:
    claim = found.certificate["claim"] | guarantees.claim()
    certificate = found.certificate | {"claim": claim} | guarantees.to_json()
    return replace(found, guarantees=guarantees, certificate=certificate)


def _scalars(found: Design) -> Scalars:
    return checked_scalars(found.system, found.k1, found.k2)


class _Limited:
    """The search for a gain that meets the demands, from a design that does not."""

    def __init__(
        self,
        start: Scalars,
        system: DelaySystem,
        demands: Demands,
        gamma: float | None,
        *,
        search: bool,
    ) -> None:
        self._system, self._demands, self._gamma = system, demands, gamma
        self._search, self._start = search, start
        self._level: tuple[float, float] | None = None
        self._free: dict[str, Any] = {}

    def best(self, plain: Design | None = None) -> Design:
        """The demands in full, then as little of them as can be proved, towards `plain`."""
        found, reason = None, ""
        for p in starts(self._start)[:_STARTS]:
            found, reason = self._at(1.0, p)
            if found is not None:
                self._start = p
                break
        if found is None:
            raise NotAchievableError(
                "no gain was found that meets what is demanded",
                where=self._system.name or None,
                expected=_words(self._demands)
                + ("" if self._gamma is None else f", and gamma = {self._gamma:g}"),
                got=reason,
                hint="less of it, other k1, k2 or their search, a larger gamma",
            )
        if self._gamma is not None or found.gamma is None or plain is None:
            return found
        self._free = self._of_itself(plain)
        low, high, strength = 0.0, 1.0, self._guess(found)
        for _ in range(_STEPS):
            if not low < strength < high:
                strength = (low + high) / 2
            other, _ = self._at(strength, self._start)
            if other is not None and other.gamma is not None and other.gamma < found.gamma:
                found, high = other, strength
            else:
                low = strength
            strength = (low + high) / 2
        return found

    def _at(self, strength: float, p: Scalars) -> tuple[Design | None, str]:
        """A design for this share of the demands, if all of them are proved of it."""
        problem = self._problem(self._eased(strength), p)
        if problem is None:
            return None, "the solver finds no feasible point"
        if self._search and problem.has_gamma:
            better = least_gamma(problem, p)
            p = p if better is None else better[0]
        try:
            found = synthesis.design(self._system, p.k1, p.k2, gamma=self._gamma, problem=problem)
        except NotAchievableError as error:
            return None, error.what
        guarantees, reason = _proved(found, self._demands)
        return (None, reason) if guarantees is None else (_with(found, guarantees), "")

    def _of_itself(self, plain: Design) -> dict[str, Any]:
        """Limits at which the LMI's own bounds say nothing new of the first design."""
        d = self._demands
        free: dict[str, Any] = {}
        X = np.array([[float(Fraction(x)) for x in row] for row in _variable(plain, "X")])
        reach = plain.K @ X @ plain.K.T
        if d.gain_limit is not None:
            least = float(np.linalg.eigvalsh(X)[0])
            free["gain_limit"] = math.sqrt(float(np.linalg.norm(reach, 2)) / least)
        if d.peak_control is not None:
            level = _level_of(X, plain.gamma, d)
            free["peak_control"] = tuple(math.sqrt(level * float(x)) for x in np.diag(reach))
        return free

    def _eased(self, strength: float) -> Demands:
        """The demands, drawn towards what the first design has: all of them at one."""
        d, inside = self._demands, 1 - _SLACK
        changes: dict[str, Any] = {}
        if d.decay is not None:
            changes["decay"] = d.decay * (1 + _SLACK) * strength
        if d.gain_limit is not None:
            free = self._free.get("gain_limit", d.gain_limit)
            changes["gain_limit"] = inside * _between(free, d.gain_limit, strength)
        if d.peak_control is not None:
            own = self._free.get("peak_control", d.peak_control)
            changes["peak_control"] = tuple(
                inside * _between(free, limit, strength)
                for limit, free in zip(d.peak_control, own, strict=True)
            )
        return replace(d, **changes)

    def _guess(self, found: Design) -> float:
        """The strength at which what is proved would just be what is demanded."""
        d, more = self._demands, found.guarantees
        pairs = []
        if d.gain_limit is not None and more.gain_limit is not None:
            pairs.append((d.gain_limit, float(more.gain_limit.bound), self._free["gain_limit"]))
        if d.peak_control is not None and more.peak_control is not None:
            has = [float(value) for value in more.peak_control.bounds]
            pairs += zip(d.peak_control, has, self._free["peak_control"], strict=True)
        shares = [
            1 - math.log(limit / has) / math.log(free / limit)
            for limit, has, free in pairs
            if free > limit > has > 0
        ]
        return max(shares, default=_NEARLY)

    def _widest(self, demands: Demands, p: Scalars) -> LimitedProblem | None:
        """The LMI without the levels, its corners at the k1, k2 that serve best."""
        if demands.decay is None:
            return LimitedProblem(self._system, demands, p)
        likely = corner_scalars(self._system, demands.decay, p)
        problems = [LimitedProblem(self._system, demands, at) for at in likely]
        if len(problems) < 2 or not problems[0].has_gamma:
            return problems[0] if problems else None
        asked = [problem.least_gamma(p) for problem in problems]
        values = [x.value if isinstance(x, Answer) else math.inf for x in asked]
        return problems[values.index(min(values))]

    def _problem(self, demands: Demands, p: Scalars) -> LimitedProblem | None:
        """The LMI, with V held at the level of least gamma; None: it cannot be met at any."""
        problem = self._widest(demands, p)
        if problem is None or demands.peak_control is None:
            return problem
        # the level is looked for without the corners of a decay, which cost most
        bare = problem
        if demands.decay is not None:
            bare = LimitedProblem(self._system, replace(demands, decay=None), p)

        def value(level: float, theta: float) -> float:
            bare.hold_level(math.exp(level), theta)
            answer = _asked(bare, p)
            if not isinstance(answer, Answer):
                return math.inf
            return answer.value if bare.has_gamma else -answer.value

        if self._level is not None:
            around = [self._level]
        else:
            free = _asked(bare, p)
            if not isinstance(free, Answer):
                return None
            level = _level_of(free.point.X, free.point.gamma, self._demands) / bare.scaling.T
            thetas = THETAS if any(Q is not None for Q in bare.structure.Q) else THETAS[:1]
            around = [(math.log(level) + step, theta) for theta in thetas for step in _COARSE]
        best, at_best = min(((value(*each), each) for each in around), key=lambda x: x[0])
        for step in _FINE:
            level, theta = at_best
            for other in ((level - step, theta), (level + step, theta)):
                here = value(*other)
                if here < best:
                    best, at_best = here, other
                    break
        if not math.isfinite(best):
            return None
        self._level = at_best
        problem.hold_level(math.exp(at_best[0]), at_best[1])
        return problem


def _asked(problem: Problem, p: Scalars) -> Answer | Solution:
    """The least gamma, or the widest margin where there is no gain to bound."""
    return problem.least_gamma(p) if problem.has_gamma else problem.margin(p, None)


def _level_of(X: NDArray[np.float64], gamma: float | None, demands: Demands) -> float:
    """The level that V reaches from the offset with the energy, but for its terms in Qbar."""
    corners = np.array(offset_corners(demands.offset or ()), dtype=float).reshape(-1, len(X))
    held = [float(x @ np.linalg.solve(X, x)) for x in corners]
    return max(held, default=0.0) + (gamma or 0.0) * (demands.energy or 0.0) ** 2


def _between(free: float, limit: float, strength: float) -> float:
    """The limit at strength 1, towards what is free of any at 0."""
    return float(limit * max(free / limit, 1.0) ** (1.0 - strength))


def _variable(found: Design, name: str) -> Any:
    return found.certificate["variables"][name]


def _words(demands: Demands) -> str:
    """What is demanded, in a sentence."""
    d = demands
    parts = []
    if d.decay is not None:
        parts.append(f"decay at {d.decay:g} 1/s")
    if d.gain_limit is not None:
        parts.append(f"|K| <= {d.gain_limit:g}")
    if d.peak_control is not None:
        parts.append(f"|u_i| <= {', '.join(f'{x:g}' for x in d.peak_control)}")
    return ", ".join(parts)

"""Gains whose nominal loop has a damping ratio, found by a descent and judged by proof.

No LMI knows of damping. So the design without it comes first. Where it misses the ratio, a direct
descent (`descent`) that starts from it makes the roots meet it and keeps the norm small; so do
others, from regulators and from gains that are drawn, until one loses little against the first
design. Every gain is judged as a given one is: gamma, the other constraints and the damping, each
by its proof.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from cosim.core import NotAchievableError
from cosim.hinf.certificate import Damping
from cosim.hinf.exact import exact
from cosim.hinf.lmi import units_of
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.synthesis.constrained_search import describe_constraints, with_guarantees
from cosim.hinf.synthesis.descent import proposals
from cosim.hinf.synthesis.designs import rounded_gain
from cosim.hinf.synthesis.loop_gain import LoopGain
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.stabilisability import NoGainError
from cosim.models import DelaySystem, Matrix

_LITTLE = 1.1
"""By how much the norm of a gain may exceed that of the design without damping."""
_PROPOSED = 3
"""Gains that are compared, if none of them loses little."""
_EVALUATIONS = 100  # of one stage of a descent
_DRAWN = 4  # starts
_REGULATORS = 2  # starts
_SHARES = (0.0, 0.5, 1.0, 1.5)  # of `within`, by which a regulator's roots lie further to the left
_WEIGHTS = (0.01, 0.1, 1.0, 10.0, 100.0)  # of the control
_RATIOS = 1000
"""A ratio that is named in a message is a multiple of 1 / this."""


def damped_design(
    system: DelaySystem,
    constraints: DesignConstraints,
    asked: Damping,
    undamped: Callable[[DesignConstraints], Result],
    proved: Callable[[Matrix], Result],
) -> Result:
    """Design a gain that meets constraints with a damping ratio among them.

    Parameters
    ----------
    system : Eq. (7).
    constraints : with `damping` and `within`, which `asked` is.
    undamped : the design for the other constraints.
    proved : the design of a given gain (m, n), with the constraints proved.

    Raises
    ------
    NotAchievableError : no gain was proved to meet them; with the best ratio that was found.
    """
    passed: list[Matrix] = []
    reasons: list[str] = []
    try:
        designed = undamped(replace(constraints, damping=None, within=None))
    except NoGainError:
        raise
    except NotAchievableError as error:
        reasons.append(f"without the damping: {error.what}")
    else:
        if asked.failure(system, designed.K) is None:
            return with_guarantees(designed, replace(designed.guarantees, damping=asked))
        passed.append(designed.K)
    gains = _damped_gains(system, constraints, passed[:])
    for K in _ranked(system, asked, gains, passed):
        try:
            return proved(K)
        except NotAchievableError as error:
            reasons.append(f"{error.what}: {error.got}")
    best = max((greatest_ratio(system, K, asked.within) for K in passed), default=0.0)
    raise NotAchievableError(
        "no gain was found that meets the design constraints",
        where=system.name or None,
        expected=describe_constraints(constraints),
        got="; ".join(
            [f"a damping ratio of {best:g}, the best of {len(passed)} gains", *reasons[:2]]
        ),
        hint="a lower damping ratio, roots less far to the left (within), weaker constraints",
    )


def greatest_ratio(system: DelaySystem, gain: Matrix, within: Any) -> float:
    """Return the greatest damping ratio, a multiple of 1/1000, that is proved; 0 where none is.

    within : how far to the left roots count [1/s], a `fmpq`.
    """
    low, high = 0, _RATIOS
    while high - low > 1:
        middle = (low + high) // 2
        tried = Damping(exact(middle / _RATIOS), within)
        low, high = (middle, high) if tried.failure(system, gain) is None else (low, middle)
    return low / _RATIOS


def _ranked(
    system: DelaySystem, asked: Damping, gains: Iterator[Matrix], passed: list[Matrix]
) -> Iterator[Matrix]:
    """Yield the gains whose damping is proved, that of the least norm first of every few.

    passed : the gains so far, the first that of the design without damping, if there is one; each
        gain is added to it.
    """
    loop = LoopGain(system)

    def size(K: Matrix) -> float:
        return float(np.exp(loop.gain(K).value)) if loop.has_gain else float(np.linalg.norm(K))

    enough = _LITTLE * size(passed[0]) if passed else 0.0
    waiting: list[tuple[float, Matrix]] = []
    for K in gains:
        passed.append(K)
        if asked.failure(system, K) is None:
            waiting.append((size(K), K))
        if waiting and (len(waiting) == _PROPOSED or waiting[-1][0] <= enough):
            yield from (gain for _, gain in sorted(waiting, key=lambda pair: pair[0]))
            waiting = []
    yield from (gain for _, gain in sorted(waiting, key=lambda pair: pair[0]))


def _damped_gains(
    system: DelaySystem, constraints: DesignConstraints, starts: list[Matrix]
) -> Iterator[Matrix]:
    """Yield gains of descents with the constraints, rounded: from `starts`, then from others."""
    units = units_of(system)[0]

    def descend(first: Sequence[Matrix], drawn: int = 0) -> Iterator[Matrix]:
        return proposals(
            system, first, drawn=drawn, evaluations=_EVALUATIONS, constraints=constraints
        )

    def some_gains() -> Iterator[Matrix]:
        yield from descend(starts)
        yield from descend(_regulators(system, constraints))
        yield from descend([], _DRAWN)

    for K in some_gains():
        # once more from its end: BFGS stalls where its estimate of the curvature is a poor one
        yield rounded_gain(next(descend([K]), K), units)


def _regulators(system: DelaySystem, constraints: DesignConstraints) -> list[Matrix]:
    """Return gains of linear-quadratic regulators whose damping is best, to start from.

    They are for x' = (sum_i A_i) x + B u, with roots left of a line (B. D. O. Anderson, J. B.
    Moore, Linear Optimal Control, 1971: A + alpha I), and predict x over the feedback's delay:
    K e^{(A + B K) d}. In units in which the states and inputs compare.
    """
    loop, (n, m) = LoopGain(system), system.B.shape
    units, within = units_of(system)[0], constraints.within or 0.0
    A = sum((x.A for x in system.delays), system.A) * units.state / units.state[:, None] * units.T
    B = system.B * units.input / units.state[:, None] * units.T
    longest = max((x.d for x in system.delays if x.feedback), default=0.0) / units.T
    regulators: list[tuple[float, float, int, Matrix]] = []
    for share, weight in itertools.product(_SHARES, _WEIGHTS):
        shifted = A + share * within * units.T * np.eye(n)
        # modes that no input moves so far to the left have no regulator
        with suppress(np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):
            X = scipy.linalg.solve_continuous_are(shifted, B, np.eye(n), weight * np.eye(m))
            K = -B.T @ X / weight
            K = K @ scipy.linalg.expm((A + B @ K) * longest) * units.input[:, None] / units.state
            K = np.where(loop.free, K, 0.0)
            if np.isfinite(K).all() and K.any():
                missed = loop.excess(K, constraints.damping or 0.0, within).value
                gain = loop.gain(K).value if loop.has_gain else 0.0
                regulators.append((max(missed, 0.0), gain, len(regulators), K))
    return [K for *_, K in sorted(regulators, key=lambda one: one[:3])[:_REGULATORS]]

"""Gains whose nominal loop has a damping ratio, found by a descent and judged by proof.

No LMI knows of damping. So the design without it comes first; where it misses the ratio, a direct
descent (`descent`) that starts from it keeps the norm small and the roots in the sector, and every
gain is judged as a given one is: gamma, the other constraints and the damping, each by its proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from cosim.core import NotAchievableError
from cosim.hinf.certificate import Damping, exact
from cosim.hinf.lmi import units_of
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.synthesis.constrained_search import describe_constraints, with_guarantees
from cosim.hinf.synthesis.descent import proposals
from cosim.hinf.synthesis.designs import Design, rounded_gain
from cosim.hinf.synthesis.stabilisability import NoGainError
from cosim.models import DelaySystem, Matrix

_DIGITS = 3
"""Decimals of a ratio that is named in a message."""


def damped_design(
    system: DelaySystem,
    constraints: DesignConstraints,
    undamped: Callable[[DesignConstraints], Design],
    proved: Callable[[Matrix], Design],
) -> Design:
    """Design a gain that meets constraints with a damping ratio among them.

    Parameters
    ----------
    system : Eq. (7).
    constraints : with `damping` and `within`.
    undamped : the design for the other constraints.
    proved : the design of a given gain (m, n), with the constraints proved.

    Raises
    ------
    NotAchievableError : no gain was proved to meet them; with the best ratio that was found.
    """
    asked = Damping(exact(constraints.damping), exact(constraints.within))
    passed: list[Matrix] = []
    reasons: list[str] = []
    try:
        found = undamped(replace(constraints, damping=None, within=None))
    except NoGainError:
        raise
    except NotAchievableError as error:
        reasons.append(f"without the damping: {error.what}")
    else:
        if asked.failure(system, found.K) is None:
            return with_guarantees(found, replace(found.guarantees, damping=asked))
        passed.append(found.K)
    for K in _damped_gains(system, constraints, passed[:]):
        passed.append(K)
        if asked.failure(system, K) is not None:
            continue
        try:
            return proved(K)
        except NotAchievableError as error:
            reasons.append(f"{error.what}: {error.got}")
    best = max((greatest_ratio(system, K, constraints.within) for K in passed), default=0.0)
    raise NotAchievableError(
        "no gain was found that meets the design constraints",
        where=system.name or None,
        expected=describe_constraints(constraints),
        got="; ".join(
            [f"{len(passed)} gains, the best with a damping ratio of {best:g}", *reasons[:2]]
        ),
        hint="a lower damping ratio, roots less far to the left (within), weaker constraints",
    )


def greatest_ratio(system: DelaySystem, gain: Matrix, within: float | None) -> float:
    """Return the greatest damping ratio, to `_DIGITS` decimals, that is proved; 0 where none is."""
    low, high = 0, 10**_DIGITS
    while high - low > 1:
        middle = (low + high) // 2
        tried = Damping(exact(middle / 10**_DIGITS), exact(within))
        low, high = (middle, high) if tried.failure(system, gain) is None else (low, middle)
    return low / 10**_DIGITS


def _damped_gains(
    system: DelaySystem, constraints: DesignConstraints, starts: list[Matrix]
) -> Iterator[Matrix]:
    """Yield gains of a descent with the constraints, rounded."""
    units = units_of(system)[0]
    for K in proposals(system, starts, constraints=constraints):
        yield rounded_gain(np.asarray(K), units)

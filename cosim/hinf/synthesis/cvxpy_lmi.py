"""The LMI of Theorem 2 as a cvxpy problem, for constraints of a user's own on X, Y, Q, R.

The inequalities are those of `cosim.hinf.theorems.theorem_2`. cvxpy is imported when `as_cvxpy` is
called; the project's own designs compile the same terms (`cosim.hinf.lmi.program`).
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError
from cosim.hinf.delay_lti import checked_system
from cosim.hinf.exact import exact
from cosim.hinf.lmi import in_cvxpy, scaling_of
from cosim.hinf.synthesis.analysis import gain_of
from cosim.hinf.synthesis.designs import check_achievable, rounded_gain
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.search import starts
from cosim.hinf.synthesis.theorem_2_gamma import checked_scalars, design
from cosim.hinf.theorems import minus_omega, positive
from cosim.models import DelaySystem, Matrix

_SINGULAR = 1e14  # condition number of X beyond which Y X^-1 is noise


@dataclass(frozen=True, eq=False, repr=False)
class CvxpyLmi:
    """The LMI of one system at given k1, k2, as a cvxpy problem.

    X, Y, Q, R, eps, gamma are variables of these names (Q1, R1 for the first delay); Y is an
    expression if the gain is given, gamma a number if it is given, Q zero for any age.

    Attributes
    ----------
    X, Y, Q, R, eps, gamma : (n, n), (m, n), Q and R one (n, n) per delay, eps and gamma scalars,
        eps a vector with an entry per block of F where there are several.
    system, k1, k2 : of the LMI.
    constraints : -Omega >= 0, X >= 0, Q >= 0, and for a delay of zero R >= 0.
    problem : minimise gamma over them; with a given gamma, or without w and z, maximise t with
        -Omega >= t I and X of trace n.
    """

    X: Any
    Y: Any
    Q: tuple[Any, ...]
    R: tuple[Any, ...]
    eps: Any
    gamma: Any
    system: DelaySystem
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    constraints: list[Any]
    problem: Any

    def __repr__(self) -> str:
        status = self.problem.status or "not solved"
        return f"<CvxpyLmi: k1 = {list(self.k1)}, k2 = {list(self.k2)}, {status}, {self.system!r}>"

    def gain(self) -> Matrix:
        """Return K = Y X^-1 (m, n) of the solved problem, rounded as in every design.

        Raises
        ------
        InputError : the variables have no value (nothing was solved), or X is singular.
        """
        X, Y = self.X.value, self.Y.value
        if X is None or Y is None or not np.linalg.cond(X) < _SINGULAR:
            raise InputError(
                "there is no gain in X and Y",
                where="X, Y",
                expected="the values of a solved problem, X regular",
                got="no value" if X is None or Y is None else "X as good as singular",
                hint="call solve() and look at its status; bound X from below, X >> 0.01 I",
            )
        K = np.asarray(np.linalg.solve(X.T, Y.T).T, dtype=np.float64)
        return rounded_gain(K, scaling_of(self.system))

    def design(self, gamma: float | None = None) -> Result:
        """Return the design with this gain, proved exactly at k1, k2.

        The proof has variables of its own, without the constraints that were added. Its least
        gamma is at most that of the problem.

        Parameters
        ----------
        gamma : a bound to prove instead of the least one of this gain.

        Raises
        ------
        InputError : as `gain`.
        NotAchievableError : the gain could not be certified.
        """
        return design(self.system, self.k1, self.k2, gamma=gamma, gain=self.gain())


def as_cvxpy(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
) -> CvxpyLmi:
    """Formulate the LMI of Theorem 2 as a cvxpy problem, to which constraints can be added.

    Parameters
    ----------
    system : Eq. (7) with delays (n states, m inputs).
    k1, k2 : one number per delay, k2 not zero.
    gamma : a bound to meet instead of the least one.
    gain : (m, n) a given gain; then Y = K X.

    Returns
    -------
    CvxpyLmi
        X (n, n) symmetric, Y (m, n), Q and R one (n, n) per delay, eps and gamma scalars (eps a
        vector where the uncertainty has several blocks), the `constraints` and the `problem`;
        after solving, `design()` proves the gain.

    Raises
    ------
    InputError : numbers that do not fit the system, or no B.
    NotAchievableError : gamma <= ||D1||.

    Examples
    --------
    A gain whose first control does not use the second state, X diagonal:

    >>> import cvxpy as cp
    >>> from cosim.hinf import as_cvxpy
    >>> from cosim.models import paper_example
    >>> lmi = as_cvxpy(paper_example.system(), [0.6], [0.2])
    >>> more = [lmi.X[0, 1] == 0, lmi.Y[0, 1] == 0]
    >>> least = cp.Problem(lmi.problem.objective, [*lmi.constraints, *more]).solve(cp.CLARABEL)
    >>> found = lmi.design()
    >>> abs(float(found.K[0, 1])) < 1e-5, found.gamma < least * 1.001
    (True, True)
    """
    import cvxpy as cp  # noqa: PLC0415 - slow to load, and few need it

    system = checked_system(system, control=True)
    p = checked_scalars(system, k1, k2)
    if gamma is not None:
        check_achievable(gamma, system)
    v = _unknowns(system, None if gain is None else gain_of(system, gain), gamma)
    by_name = {"X": v["X"], "Y": v["Y"], "gamma": v["gamma"]}
    by_name |= {f"{name}[{j}]": M for name in "QR" for j, M in enumerate(v[name])}
    blocks = len(system.blocks)
    by_name |= {f"eps[{b}]": v["eps"][b] if blocks > 1 else v["eps"] for b in range(blocks)}
    k = [exact(x) for x in p.k1], [exact(x) for x in p.k2]
    bounded = system.has_performance
    inequality = in_cvxpy(minus_omega(system, *k, bounded=bounded), by_name)
    least = gamma is None and bounded
    margin = 0.0 if least else cp.Variable(name="margin")
    constraints = [(inequality + inequality.T) / 2 >> margin * np.eye(inequality.shape[0])]
    constraints += [in_cvxpy(one, by_name) >> 0 for one in positive(system)]
    if least:
        objective: Any = cp.Minimize(v["gamma"])
    else:
        # without a free gamma the LMI is homogeneous: fix the size of the solution
        constraints.append(sum(v["X"][i, i] for i in range(len(system.A))) == len(system.A))
        objective = cp.Maximize(margin)
    problem = cp.Problem(objective, constraints)
    return CvxpyLmi(**v, system=system, k1=p.k1, k2=p.k2, constraints=constraints, problem=problem)


def _unknowns(system: DelaySystem, gain: Matrix | None, gamma: float | None) -> dict[str, Any]:
    """Return new variables; with a given `gain` Y = K X, a given `gamma` is a number."""
    import cvxpy as cp  # noqa: PLC0415

    n, m = system.B.shape
    blocks, delays = len(system.blocks), list(enumerate(system.delays, 1))
    X = cp.Variable((n, n), symmetric=True, name="X")
    return {
        "X": X,
        "Y": cp.Variable((m, n), name="Y") if gain is None else gain @ X,
        "Q": tuple(
            np.zeros((n, n)) if x.any_age else cp.Variable((n, n), symmetric=True, name=f"Q{j}")
            for j, x in delays
        ),
        "R": tuple(cp.Variable((n, n), symmetric=True, name=f"R{j}") for j, _ in delays),
        "eps": cp.Variable(blocks, name="eps") if blocks > 1 else cp.Variable(name="eps"),
        "gamma": cp.Variable(name="gamma") if gamma is None else gamma,
    }


def cvxpy_design(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool = False,
) -> Result:
    """Design a gain by `as_cvxpy` with Clarabel, and prove it by Theorem 2 at the same k1, k2.

    search : also try the fixed starts of a search, and take the best.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no pair k1, k2 gives a gain that can be certified.
    """
    import cvxpy as cp  # noqa: PLC0415

    p = checked_scalars(system, k1, k2)
    statuses: Counter[str] = Counter()
    best: list[tuple[float, CvxpyLmi]] = []
    for at in starts(p) if search else [p]:
        lmi = as_cvxpy(system, at.k1, at.k2, gamma=gamma, gain=gain)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # an inaccurate point is for the proof to judge
                value = lmi.problem.solve(solver=cp.CLARABEL)
        except cp.SolverError:
            statuses["failed"] += 1
            continue
        statuses[str(lmi.problem.status)] += 1
        margin = isinstance(lmi.problem.objective, cp.Maximize)
        if lmi.X.value is not None and np.isfinite(value) and (not margin or value > 0):
            best.append((0.0 if margin else float(value), lmi))
    reason = ""
    for _, lmi in sorted(best, key=lambda pair: pair[0]):
        try:
            return lmi.design(gamma) if gain is None else design(system, lmi.k1, lmi.k2, gain=gain)
        except (InputError, NotAchievableError) as error:
            reason = f", but not proved: {error.what}"
    raise NotAchievableError(
        "no solution of the plain LMI was found and certified with cvxpy",
        where=system.name or None,
        expected="a solution whose gain is proved exactly",
        got=", ".join(f"{word} at {n} starts" for word, n in statuses.items()) + reason,
        hint="a larger gamma, or the solver clarabel",
    )
